//! Addresses that the settings name: of the webhook and of cameras. They may contain secrets, so messages have at most
//! their scheme and host.

use axum::http::Uri;
use axum::http::uri::{Authority, Scheme};

/// An `http:` or `https:` address with a host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WebAddress {
    scheme: Scheme,
    authority: Authority,
    path: String,
}

impl WebAddress {
    /// Parses an address. `None` if it has another scheme or no host.
    pub fn parse(text: &str) -> Option<Self> {
        let parts = text.parse::<Uri>().ok()?.into_parts();
        let scheme = parts.scheme.filter(|scheme| *scheme == Scheme::HTTP || *scheme == Scheme::HTTPS)?;
        let path = parts.path_and_query.map_or_else(|| "/".to_owned(), |path| path.as_str().to_owned());
        Some(Self { scheme, authority: parts.authority?, path })
    }

    /// Returns the address to which a response redirects. `None` if it is on another host, or by another scheme.
    pub fn redirected(&self, location: &str) -> Option<Self> {
        if location.starts_with('/') && !location.starts_with("//") {
            let path = location.parse::<Uri>().ok()?.path_and_query()?.as_str().to_owned();
            return Some(Self { path, ..self.clone() });
        }
        let other = Self::parse(location)?;
        let is_same = other.scheme == self.scheme
            && other.authority.host() == self.authority.host()
            && other.authority.port_u16() == self.authority.port_u16();
        // The credentials of the settings stay in use.
        is_same.then(|| Self { path: other.path, ..self.clone() })
    }

    /// Returns the whole address.
    pub fn to_text(&self) -> String {
        format!("{}://{}{}", self.scheme, self.authority, self.path)
    }

    /// Returns the scheme and the host, for messages.
    pub fn origin(&self) -> String {
        format!("{}://{}", self.scheme, self.authority.host())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_web_addresses_with_a_host_are_accepted() {
        for text in ["", "camera", "/picture", "ftp://host/", "file:///etc/passwd", "http://", "http:///a", "a b"] {
            assert_eq!(WebAddress::parse(text), None, "{text}");
        }
        for text in ["http://host/", "https://user:secret@host:8080/a?b=c"] {
            assert_eq!(WebAddress::parse(text).unwrap().to_text(), text);
        }
        assert_eq!(WebAddress::parse("https://user:secret@host:8080/a?b=c").unwrap().origin(), "https://host");
    }

    #[test]
    fn redirects_stay_on_the_host() {
        let address = WebAddress::parse("http://user:secret@camera:81/a").unwrap();
        let to = |location| address.redirected(location).map(|to| to.to_text());
        assert_eq!(to("/b?c=1").as_deref(), Some("http://user:secret@camera:81/b?c=1"));
        assert_eq!(to("http://camera:81/b").as_deref(), Some("http://user:secret@camera:81/b"));
        for other in
            ["http://other/", "//other/", "https://camera:81/", "http://camera/", "http://camera:82/b", "b", ""]
        {
            assert_eq!(to(other), None, "{other}");
        }
    }
}
