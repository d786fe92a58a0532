//! Pages that need nothing else: no network, no other file.

use crate::console::{MADE_BY, harmless};

/// Whether a page runs the script that is written into it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Script {
    None,
    Own,
}

/// A page with a title, which is text, and a style and a body, which are HTML.
pub fn document(title: &str, style: &str, script: Script, body: &str) -> String {
    let title = escape(title);
    let script = match script {
        Script::None => "",
        Script::Own => "; script-src 'unsafe-inline'",
    };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'{script}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"generator\" content=\"{MADE_BY}\">\n\
         <title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    )
}

/// Text as HTML has it, also inside of quotes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in harmless(text).chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_text() {
        let hostile = "<script>alert('x')</script>&\"";
        let text = escape(hostile);
        assert_eq!(
            text,
            "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;&amp;&quot;"
        );
        let page = document(hostile, "", Script::None, "");
        assert!(!page.contains("<script") && !page.contains("script-src"));
        assert_eq!(escape("a\u{1b}b\u{202E}c\n"), "a\u{FFFD}b\u{FFFD}c\n");
    }
}
