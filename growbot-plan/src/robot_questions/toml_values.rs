//! Values and comments of a TOML document.

use toml_edit::{Item, RawString, Value};

use crate::text_wrap::wrap;

/// Returns a value as TOML, without its comment.
pub(super) fn shown(value: &Value) -> String {
    let mut value = value.clone();
    value.decor_mut().clear();
    value.to_string().trim().to_owned()
}

/// Returns the comment after a value.
pub(super) fn trailing_comment(value: &Value) -> String {
    let suffix = value.decor().suffix().and_then(RawString::as_str).unwrap_or_default();
    suffix.split_once('#').map(|(_, comment)| comment.trim().to_owned()).unwrap_or_default()
}

/// Formats a text as comment lines.
pub(super) fn comment(text: &str) -> String {
    wrap(text, 120, "# ", "# ")
}

/// Returns the value at a path of keys.
pub(super) fn look_up<'a>(item: &'a Item, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(item, |item, key| item.get(key))?.as_value()
}

/// Returns the value at a path of keys, for changing it.
pub(super) fn look_up_mut<'a>(item: &'a mut Item, path: &str) -> Option<&'a mut Value> {
    path.split('.').try_fold(item, |item, key| item.get_mut(key))?.as_value_mut()
}

/// Removes the value at a path of keys.
pub(super) fn remove(item: &mut Item, path: &str) {
    let (table, key) = path.rsplit_once('.').unwrap_or(("", path));
    let table = table.split('.').filter(|key| !key.is_empty()).try_fold(item, |item, key| item.get_mut(key));
    if let Some(table) = table.and_then(Item::as_table_like_mut) {
        table.remove(key);
    }
}

/// Returns the paths of all values below `item` that have their own line. `here` is the path of `item` itself.
pub(super) fn paths(item: &Item, here: &str) -> Vec<String> {
    let Some(table) = item.as_table() else { return vec![here.to_owned()] };
    let below = |key: &str| if here.is_empty() { key.to_owned() } else { format!("{here}.{key}") };
    table.iter().flat_map(|(key, item)| paths(item, &below(key))).collect()
}
