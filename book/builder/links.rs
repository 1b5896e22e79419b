//! Check of the built pages: each link must have a target, and no page may load anything from a network.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result, bail};

/// Numbers of pages and links that were checked.
pub struct LinkCheckSummary {
    pages: usize,
    links: usize,
}

impl fmt::Display for LinkCheckSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} pages, {} links", self.pages, self.links)
    }
}

/// An HTML start tag: its name and its attributes.
struct Tag {
    name: String,
    attributes: Vec<(String, String)>,
}

/// An HTML page: the targets of its links, the addresses that it loads, and its anchors.
struct Page {
    links: Vec<String>,
    fetches: Vec<String>,
    places: BTreeSet<String>,
}

/// Checks all HTML pages and style sheets below a directory.
///
/// # Errors
/// Fails with a list of all links without a target, and of all addresses that pages would load from a network.
pub fn check(directory: &Path) -> Result<LinkCheckSummary> {
    let mut files = Vec::new();
    list(directory, &mut files)?;
    let mut pages = BTreeMap::new();
    for file in files.iter().filter(|file| file.extension().is_some_and(|extension| extension == "html")) {
        let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
        pages.insert(normal(file), page(&text));
    }
    let mut wrong = Vec::new();
    for file in files.iter().filter(|file| file.extension().is_some_and(|extension| extension == "css")) {
        let text = fs::read_to_string(file)?;
        for target in text.split("url(").skip(1).filter_map(|rest| rest.split(')').next()) {
            if is_elsewhere(target.trim_matches(['"', '\''])) {
                wrong.push(format!("{}: asks the network for {target}", file.display()));
            }
        }
    }
    let mut links = 0;
    for (file, page) in &pages {
        // The error page for missing addresses has links relative to the root of a server.
        if file.ends_with("404.html") {
            continue;
        }
        let name = file.strip_prefix(directory).unwrap_or(file).display();
        for target in &page.fetches {
            if is_elsewhere(target) {
                wrong.push(format!("{name}: asks the network for {target}"));
            }
        }
        for target in page.links.iter().chain(&page.fetches).filter(|target| !is_elsewhere(target)) {
            links += 1;
            if let Err(reason) = leads_somewhere(file, target, &pages) {
                wrong.push(format!("{name}: {target} leads nowhere: {reason}"));
            }
        }
    }
    if pages.is_empty() || links == 0 {
        bail!("there are no pages with links in {}", directory.display());
    }
    if !wrong.is_empty() {
        bail!("the pages are wrong in {} places:\n  {}", wrong.len(), wrong.join("\n  "));
    }
    Ok(LinkCheckSummary { pages: pages.len(), links })
}

fn list(directory: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(directory)? {
        let path = entry?.path();
        if path.is_dir() { list(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

fn leads_somewhere(from: &Path, target: &str, pages: &BTreeMap<PathBuf, Page>) -> Result<(), &'static str> {
    let (path, place) = target.split_once('#').map_or((target, None), |(path, place)| (path, Some(place)));
    let path = path.split('?').next().unwrap_or(path);
    let file = match path {
        "" => from.to_owned(),
        path => normal(&from.parent().unwrap_or(Path::new(".")).join(path)),
    };
    let file = if file.is_dir() { file.join("index.html") } else { file };
    if !file.is_file() {
        return Err("there is no such file");
    }
    match (place, pages.get(&file)) {
        (None | Some(""), _) => Ok(()),
        (Some(place), Some(page)) if page.places.contains(place) => Ok(()),
        (Some(_), Some(_)) => Err("the page has no such place"),
        (Some(_), None) => Err("the file has no places"),
    }
}

/// Returns the path without `.` and `..`.
pub fn normal(path: &Path) -> PathBuf {
    let mut whole = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => drop(whole.pop()),
            Component::CurDir => {}
            component => whole.push(component),
        }
    }
    whole
}

fn is_elsewhere(target: &str) -> bool {
    ["http:", "https:", "//", "mailto:"].iter().any(|scheme| target.starts_with(scheme))
}

fn page(html: &str) -> Page {
    let mut page = Page { links: Vec::new(), fetches: Vec::new(), places: BTreeSet::new() };
    for tag in tags(html) {
        for (attribute, value) in tag.attributes {
            match (tag.name.as_str(), attribute.as_str()) {
                ("a", "href") => page.links.push(value),
                (_, "href" | "src" | "poster" | "data") if !value.starts_with("data:") => page.fetches.push(value),
                (_, "id") => drop(page.places.insert(value)),
                // For a block of this class, mdBook's script sends a request to this server.
                (_, "class") if value.split(' ').any(|class| class == "playground") => {
                    page.fetches.push("https://play.rust-lang.org".to_owned());
                }
                _ => {}
            }
        }
    }
    page
}

/// Returns all start tags of an HTML text outside of scripts, style sheets and comments.
fn tags(html: &str) -> Vec<Tag> {
    let mut found = Vec::new();
    let mut rest = html;
    while let Some(place) = rest.find('<') {
        rest = &rest[place + 1..];
        if let Some(comment) = rest.strip_prefix("!--") {
            rest = comment.split_once("-->").map_or("", |(_, after)| after);
            continue;
        }
        if !rest.starts_with(|c: char| c.is_ascii_alphabetic()) {
            continue;
        }
        let (tag, after) = tag(rest);
        rest = after;
        for opaque in ["script", "style"] {
            if tag.name == opaque {
                rest = rest.split_once(&format!("</{opaque}")).map_or("", |(_, after)| after);
            }
        }
        found.push(tag);
    }
    found
}

/// Parses the tag at the start of the text, which follows a `<`. Returns the tag and the rest of the text.
fn tag(text: &str) -> (Tag, &str) {
    let end = text.find(|c: char| c.is_whitespace() || c == '>' || c == '/').unwrap_or(text.len());
    let mut tag = Tag { name: text[..end].to_ascii_lowercase(), attributes: Vec::new() };
    let mut rest = &text[end..];
    loop {
        rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == '/');
        if rest.is_empty() {
            return (tag, "");
        }
        if let Some(after) = rest.strip_prefix('>') {
            return (tag, after);
        }
        let end = rest.find(|c: char| c.is_whitespace() || c == '=' || c == '>' || c == '/').unwrap_or(rest.len());
        // A single character that is not part of an attribute is skipped.
        let (name, after) = rest.split_at(end.max(rest.chars().next().map_or(0, char::len_utf8)));
        rest = after;
        let Some(value) = rest.strip_prefix('=') else { continue };
        let quote = value.chars().next().filter(|c| ['"', '\''].contains(c));
        let (value, after) = match quote {
            Some(quote) => value[1..].split_once(quote).unwrap_or((&value[1..], "")),
            None => value.split_at(value.find(|c: char| c.is_whitespace() || c == '>').unwrap_or(value.len())),
        };
        rest = after;
        let value = value.replace("&amp;", "&").replace("&quot;", "\"").replace("&#x27;", "'");
        tag.attributes.push((name.to_ascii_lowercase(), value));
    }
}
