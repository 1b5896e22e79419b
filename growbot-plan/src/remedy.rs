//! Texts of errors with the remedies of a user interface. The errors of this library name no option of the command line
//! and no argument of Python, so each user interface adds its own remedies.

use std::error::Error;

/// Returns the text of an error to which a user interface has added its remedies. `add_remedy` returns the text of one
/// error with its remedy, and is called for the error and for each of its causes.
pub fn with_remedies(
    error: &(dyn Error + 'static),
    add_remedy: fn(&(dyn Error + 'static), String) -> String,
) -> String {
    let mut text = error.to_string();
    if let Some(cause) = error.source() {
        text = text.replacen(&cause.to_string(), &with_remedies(cause, add_remedy), 1);
    }
    add_remedy(error, text)
}
