//! Natural order: `seq_2` before `seq_10`.

use std::cmp::Ordering;

/// Compares runs of ASCII digits by value and everything else by character. Texts that differ
/// only in leading zeros are ordered as plain text.
pub(crate) fn compare(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a, b);
    loop {
        let (Some(cx), Some(cy)) = (x.chars().next(), y.chars().next()) else {
            return x.len().cmp(&y.len()).then_with(|| a.cmp(b));
        };
        let step = if cx.is_ascii_digit() && cy.is_ascii_digit() {
            let (nx, ny) = (digits(&mut x), digits(&mut y));
            nx.len().cmp(&ny.len()).then_with(|| nx.cmp(ny))
        } else {
            x = &x[cx.len_utf8()..];
            y = &y[cy.len_utf8()..];
            cx.cmp(&cy)
        };
        if step.is_ne() {
            return step;
        }
    }
}

/// Takes the digits at the front, without leading zeros.
fn digits<'a>(text: &mut &'a str) -> &'a str {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    *text = rest;
    number.trim_start_matches('0')
}

#[cfg(test)]
mod tests {
    use super::compare;
    use proptest::prelude::*;
    use std::cmp::Ordering;

    #[test]
    fn counts_as_people_do() {
        let mut ids = [
            "10", "B2", "2", "A10", "A2", "train_10", "train_9", "02", "1",
        ];
        ids.sort_by(|a, b| compare(a, b));
        assert_eq!(
            ids,
            [
                "1", "02", "2", "10", "A2", "A10", "B2", "train_9", "train_10"
            ]
        );
    }

    proptest! {
        #[test]
        fn is_a_total_order(a in "[a0-2_é]{0,5}", b in "[a0-2_é]{0,5}", c in "[a0-2_é]{0,5}") {
            prop_assert_eq!(compare(&a, &b), compare(&b, &a).reverse());
            prop_assert_eq!(compare(&a, &b) == Ordering::Equal, a == b);
            if compare(&a, &b).is_le() && compare(&b, &c).is_le() {
                prop_assert!(compare(&a, &c).is_le());
            }
        }
    }
}
