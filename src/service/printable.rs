//! Which characters a text that a client chose may have, because a terminal may print it.
//!
//! A terminal obeys control characters: C0 and C1 begin escape sequences, which move the cursor, change the
//! title or send input. Direction marks reorder the text around them, so that a name reads as another one.
//! Neither has a place in a path or a name.

use std::borrow::Cow;
use std::fmt::Write;

/// Whether a terminal prints the character where it stands, and nothing else happens.
pub(super) fn is_printable(character: char) -> bool {
    let is_direction = matches!(
        character,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    );
    // Terminals and editors may break lines at these two.
    let is_break = matches!(character, '\u{2028}' | '\u{2029}');
    !character.is_control() && !is_direction && !is_break
}

/// The text with `\u001b` and the like in place of characters that are not printable, but for those in
/// `kept`. Within a string of JSON they mean the same characters.
pub(crate) fn escaped<'t>(text: &'t str, kept: &[char]) -> Cow<'t, str> {
    let is_plain = |character: char| is_printable(character) || kept.contains(&character);
    if text.chars().all(is_plain) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_plain(character) {
            out.push(character);
        } else {
            // Writing to a string does not fail; all of these are below U+10000.
            let _done = write!(out, "\\u{:04x}", u32::from(character));
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_obeys_is_escaped_and_all_else_stays() {
        let plain = "Türe 4/地図 – Δ 🤖.g2o";
        assert!(matches!(escaped(plain, &[]), Cow::Borrowed(text) if text == plain));
        let bad = "a\u{1b}[2Jb\u{9b}c\u{7f}\u{202e}d\u{2066}\u{2028}\n";
        let wanted = "a\\u001b[2Jb\\u009bc\\u007f\\u202ed\\u2066\\u2028";
        assert_eq!(escaped(bad, &['\n']), format!("{wanted}\n"));
        assert_eq!(escaped(bad, &[]), format!("{wanted}\\u000a"));
        // The same characters, where it is JSON.
        let json = serde_json::to_string(bad).unwrap();
        let read: String = serde_json::from_str(&escaped(&json, &[])).unwrap();
        assert_eq!(read, bad);
    }
}
