/// How deep the elements of an XML text are nested. The parser recurses, and a text nested deep
/// enough would exhaust its stack, which is not an error one can catch.
pub(crate) fn depth(text: &str) -> usize {
    let (mut rest, mut depth, mut deepest) = (text, 0usize, 0);
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let until = |end: &str| rest.find(end).map_or(rest.len(), |at| at + end.len());
        let length = if rest.starts_with("<!--") {
            until("-->")
        } else if rest.starts_with("<![CDATA[") {
            until("]]>")
        } else {
            let tag = &rest[..tag_length(rest)];
            if tag.starts_with("</") {
                depth = depth.saturating_sub(1);
            } else if !(tag.starts_with("<?") || tag.starts_with("<!") || tag.ends_with("/>")) {
                depth += 1;
                deepest = deepest.max(depth);
            }
            tag.len()
        };
        rest = &rest[length..];
    }
    deepest
}

/// Length of the tag that `text` begins with; a `>` in quotes does not end it.
fn tag_length(text: &str) -> usize {
    let mut quote = None;
    for (at, c) in text.char_indices() {
        match quote {
            Some(q) if c == q => quote = None,
            None if c == '>' => return at + 1,
            None if c == '"' || c == '\'' => quote = Some(c),
            _ => {}
        }
    }
    text.len()
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
}
