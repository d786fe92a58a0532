//! Checks of the tags of an XML text, for inputs that the parser does not handle.

/// How deep the elements are nested. The parser recurses, and a deeply nested text would overflow its
/// stack, which cannot be caught as an error.
pub(crate) fn depth(text: &str) -> usize {
    let (mut depth, mut deepest) = (0usize, 0);
    for tag in tags(text) {
        if tag.starts_with("</") {
            depth = depth.saturating_sub(1);
        } else if opens(tag) {
            depth += 1;
            deepest = deepest.max(depth);
        }
    }
    deepest
}

/// The first error in how elements open and close, with its line. The lines that the parser reports are those of a text that
/// it generates itself.
pub(crate) fn unbalanced(text: &str) -> Option<(usize, String)> {
    let line = |tag: &str| line(text, place(text, tag));
    let mut open: Vec<&str> = Vec::new();
    let mut outermost = None;
    let mut end = 0;
    for tag in tags(text) {
        if !tag.ends_with('>') {
            return Some((line(tag), format!("<{} has no end", name(tag))));
        }
        end = place(text, tag) + tag.len();
        if begins_element(tag) {
            if let (true, Some(first)) = (open.is_empty(), outermost) {
                let problem = format!("<{}> after the end of <{first}>", name(tag));
                return Some((line(tag), problem));
            }
            outermost = outermost.or(Some(name(tag)));
        }
        if let Some(closed) = tag.strip_prefix("</").map(|_| name(tag)) {
            match open.pop() {
                Some(opened) if name(opened) == closed => {}
                Some(opened) => {
                    let (opened, from) = (name(opened), line(opened));
                    let problem = format!("</{closed}> where <{opened}> of line {from} is open");
                    return Some((line(tag), problem));
                }
                None => return Some((line(tag), format!("</{closed}> closes nothing"))),
            }
        } else if opens(tag) {
            open.push(tag);
        }
    }
    if let Some(opened) = open.pop() {
        return Some((line(opened), format!("<{}> is never closed", name(opened))));
    }
    let mut behind = text[end..].trim_start();
    while let Some(comment) = behind.strip_prefix("<!--") {
        behind = comment.split_once("-->").map_or("", |(_, rest)| rest);
        behind = behind.trim_start();
    }
    let first = outermost.filter(|_| !behind.is_empty())?;
    Some((line(behind), format!("text after the end of <{first}>")))
}

/// A direct child of the outermost element.
pub(crate) struct Child<'a> {
    /// Its text.
    whole: &'a str,
    /// The tag that opens the outermost one.
    outermost: &'a str,
}

impl<'a> Child<'a> {
    /// The name of the element.
    pub(crate) fn name(&self) -> &'a str {
        name(self.whole)
    }

    /// The line of the whole text that it begins in.
    pub(crate) fn line(&self, text: &str) -> usize {
        line(text, place(text, self.whole))
    }

    /// A text with the outermost element that contains only this element.
    pub(crate) fn alone(&self) -> String {
        let Self { whole, outermost } = self;
        format!("{outermost}{whole}</{}>", name(outermost))
    }
}

/// The direct children of the outermost element of a balanced text.
pub(crate) fn children(text: &str) -> Vec<Child<'_>> {
    let mut found = Vec::new();
    let mut open: Vec<&str> = Vec::new();
    for tag in tags(text) {
        let first = if tag.starts_with("</") {
            open.pop()
        } else if opens(tag) {
            open.push(tag);
            None
        } else {
            tag.ends_with("/>").then_some(tag)
        };
        if let (Some(first), [outermost]) = (first, &open[..]) {
            let begin = place(text, first);
            let whole = &text[begin..place(text, tag) + tag.len()];
            found.push(Child { whole, outermost });
        }
    }
    found
}

/// Whether a tag opens an element that another tag closes.
pub(crate) fn opens(tag: &str) -> bool {
    begins_element(tag) && !tag.ends_with("/>")
}

/// Whether a tag begins an element, or is a whole element.
pub(crate) fn begins_element(tag: &str) -> bool {
    !["</", "<?", "<!"].iter().any(|s| tag.starts_with(s))
}

/// Where a part of the text begins.
pub(crate) fn place(text: &str, part: &str) -> usize {
    part.as_ptr() as usize - text.as_ptr() as usize
}

/// The line of a place in the text.
pub(crate) fn line(text: &str, at: usize) -> usize {
    1 + text[..at].matches('\n').count()
}

/// Name of the element of a tag.
pub(crate) fn name(tag: &str) -> &str {
    let from = tag.trim_start_matches(['<', '/']);
    let end = from.find(|c: char| c.is_whitespace() || matches!(c, '/' | '>'));
    &from[..end.unwrap_or(from.len())]
}

/// Whether a name has an empty prefix (`:name`), or the prefix `xmlns` is declared anew. The parser panics
/// where it writes such names again.
pub(crate) fn bad_prefix(text: &str) -> bool {
    // Anywhere in the text, since the parser treats stray quotes in its own way.
    text.contains("xmlns:xmlns")
        || tags(text).any(|tag| {
            let bare: String = without_values(tag).map(|(_, c)| c).collect();
            let begins = |before: char| matches!(before, '<' | '/') || before.is_whitespace();
            let mut pairs = bare.chars().zip(bare.chars().skip(1));
            pairs.any(|(before, c)| c == ':' && begins(before))
        })
}

/// Names of the attributes of a tag.
pub(crate) fn attributes(tag: &str) -> impl Iterator<Item = &str> {
    let mut from = 0;
    without_values(tag).filter_map(move |(at, c)| {
        if c != '=' {
            return None;
        }
        let before = &tag[std::mem::replace(&mut from, at + 1)..at];
        before.split_whitespace().next_back()
    })
}

/// The values of all attributes of this name, each with the tag that it is in.
pub(crate) fn values<'a>(text: &'a str, wanted: &str) -> impl Iterator<Item = (&'a str, &'a str)> {
    tags(text).filter_map(move |tag| {
        let name = attributes(tag).find(|a| *a == wanted)?;
        let behind = &tag[place(tag, name) + name.len()..];
        let quote = behind.find(['"', '\''])?;
        let value = &behind[quote + 1..];
        Some((tag, value.split(&behind[quote..=quote]).next()?))
    })
}

/// The characters of a text that begins outside of quotes, each with its position. Quoted values become blanks.
fn without_values(text: &str) -> impl Iterator<Item = (usize, char)> {
    let mut quote = None;
    text.char_indices().map(move |(at, c)| {
        match quote {
            Some(q) => quote = Some(q).filter(|q| *q != c),
            None if c == '"' || c == '\'' => quote = Some(c),
            None => return (at, c),
        }
        (at, ' ')
    })
}

/// The tags in order, without comments and character data.
pub(crate) fn tags(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        loop {
            rest = &rest[rest.find('<')?..];
            let until = |end: &str| rest.find(end).map_or(rest.len(), |at| at + end.len());
            if rest.starts_with("<!--") {
                rest = &rest[until("-->")..];
            } else if rest.starts_with("<![CDATA[") {
                rest = &rest[until("]]>")..];
            } else {
                let (tag, after) = rest.split_at(tag_length(rest));
                rest = after;
                return Some(tag);
            }
        }
    })
}

/// Length of the tag that `text` begins with; a `>` in quotes does not end it.
fn tag_length(text: &str) -> usize {
    let end = without_values(text).find(|(_, c)| *c == '>');
    end.map_or(text.len(), |(at, _)| at + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_open_elements_count() {
        assert_eq!(depth(""), 0);
        assert_eq!(
            depth("<?xml?><!DOCTYPE x><a><b/><c d='>'><e/></c><f/></a>"),
            2
        );
        assert_eq!(depth("<a><!-- <b><c><d> --><![CDATA[<b><c>]]></a>"), 1);
        assert_eq!(depth("<a b=\"/>\"><a b='\">'><a></a></a></a>"), 3);
        assert_eq!(depth("</a></a><a"), 1);
        assert_eq!(depth("<é><\"ü"), 2);
    }

    #[test]
    fn what_does_not_close_has_a_line() {
        for (text, line, says) in [
            ("<a>\n<b>\n</a>", 3, "</a> where <b> of line 2 is open"),
            ("<a/>\n\n</c >", 3, "</c> closes nothing"),
            ("<?xml?>\n<a x='>'>\n<b/>", 2, "<a> is never closed"),
            ("<a>\n<b x='1'", 2, "<b has no end"),
            ("<a/>\n<!-- x -->\n<b></b>", 3, "<b> after the end of <a>"),
            ("<a></a><!-- x -->\nb\n", 2, "text after the end of <a>"),
            (
                "<a\nx='1'><!--\n</b>\n--></b>",
                4,
                "</b> where <a> of line 1",
            ),
        ] {
            let (at, problem) = unbalanced(text).unwrap();
            assert_eq!(at, line, "{text}: {problem}");
            assert!(problem.contains(says), "{text}: {problem}");
        }
        for text in [
            "",
            "hello",
            "<a><b/><c d='</e>'></c><!-- <f> --></a>\n<!-- b -->\n",
        ] {
            assert_eq!(unbalanced(text), None, "{text}");
        }
    }

    #[test]
    fn children_are_those_of_the_outermost_element() {
        let text = "<?xml?>\n<r a='1'>\n <b/>\n <c x='>'><d/>\n </c><!-- <e/> -->\n</r>";
        let found = children(text);
        let of = |c: &Child<'_>| (c.line(text), c.name().to_owned(), c.alone());
        let expected = [
            (3, "b", "<r a='1'><b/></r>"),
            (4, "c", "<r a='1'><c x='>'><d/>\n </c></r>"),
        ];
        let expected = expected.map(|(l, e, a)| (l, e.to_owned(), a.to_owned()));
        assert_eq!(found.iter().map(of).collect::<Vec<_>>(), expected);
        assert!(children("<r/>").is_empty() && children("").is_empty());
    }

    #[test]
    fn prefixes_are_of_names() {
        for text in [
            "<a :b='1'/>",
            "<:a/>",
            "</:a>",
            "<a\n:b='1'>",
            "<a c='1':b='1'>",
            "<a xmlns:xmlns='u'/>",
        ] {
            assert!(bad_prefix(text), "{text}");
        }
        for text in [
            "<a x:b='1'/>",
            "<a b=' :c'/>",
            "<a> :b </a>",
            "<!-- <:a/> -->",
        ] {
            assert!(!bad_prefix(text), "{text}");
        }
    }
}
