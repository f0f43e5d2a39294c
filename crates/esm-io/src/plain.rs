//! Names from files in messages: what would move a terminal's cursor or change its colours is written out.

use std::fmt::{self, Write};

/// Shows a text with its control characters escaped: `\u{1b}`, `\n`.
pub(crate) struct Plain<T>(pub(crate) T);

impl<T: fmt::Display> fmt::Display for Plain<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(Escaping(f), "{}", self.0)
    }
}

struct Escaping<'a, 'b>(&'a mut fmt::Formatter<'b>);

impl Write for Escaping<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().try_for_each(|c| {
            // Also what breaks lines and what turns the direction of writing.
            let hidden = c.is_control()
                || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
            if hidden { write!(self.0, "{}", c.escape_debug()) } else { self.0.write_char(c) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_nothing_else() {
        let text = "/a\u{1b}[31m'b'\\ \"ü\"\n\u{7f}\u{9b}\u{202e}";
        let plain = r#"/a\u{1b}[31m'b'\ "ü"\n\u{7f}\u{9b}\u{202e}"#;
        assert_eq!(Plain(text).to_string(), plain);
    }
}
