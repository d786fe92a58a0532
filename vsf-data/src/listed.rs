/// Most names that are listed, and most letters of one.
const MOST: usize = 20;
const LONGEST: usize = 120;

/// Formats a list of names for a message: the first twenty, and how many more there are.
///
/// Long names are cut. An empty list gives "nothing".
///
/// ```
/// assert_eq!(vsf_data::listed(&["a", "b"]), "a, b");
/// let many: Vec<String> = (0..1000).map(|k| k.to_string()).collect();
/// assert!(vsf_data::listed(&many).ends_with("18, 19 and 980 more"));
/// ```
pub fn listed<T: AsRef<str>>(names: &[T]) -> String {
    if names.is_empty() {
        return "nothing".to_owned();
    }
    let short = |name: &T| match name.as_ref().char_indices().nth(LONGEST) {
        None => name.as_ref().to_owned(),
        Some((end, _)) => format!("{}...", &name.as_ref()[..end]),
    };
    let shown: Vec<String> = names.iter().take(MOST).map(short).collect();
    let more = match names.len().saturating_sub(MOST) {
        0 => String::new(),
        others => format!(" and {others} more"),
    };
    shown.join(", ") + &more
}
