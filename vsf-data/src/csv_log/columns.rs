//! What columns are by their titles.

use std::collections::HashMap;

/// Titles of the time \[s\].
const TIME: [&str; 4] = ["time", "t", "timestamp", "time_s"];

/// What stands between a word and the name of a joint.
const BETWEEN: [char; 3] = ['_', '.', '/'];

/// Titles that will do.
const EXAMPLE: &str = "time, q_NAME, tau_NAME";

/// What is measured of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Position,
    Velocity,
    Effort,
}

impl Quantity {
    const ALL: [Self; 3] = [Self::Position, Self::Velocity, Self::Effort];

    pub fn name(self) -> &'static str {
        self.words()[0]
    }

    /// What it is called in titles.
    fn words(self) -> &'static [&'static str] {
        match self {
            Self::Position => &["position", "pos", "q"],
            Self::Velocity => &["velocity", "vel", "dq", "qd"],
            Self::Effort => &["effort", "torque", "tau"],
        }
    }

    /// The titles by which a joint may have it.
    fn titles(self, joint: &str) -> String {
        let titles = self.words().iter().map(|word| format!("{word}_{joint}"));
        titles.collect::<Vec<_>>().join(", ")
    }
}

/// The columns of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns {
    titles: Vec<String>,
    time: usize,
    joints: Vec<Joint>,
}

#[derive(Debug, Clone, PartialEq)]
struct Joint {
    name: String,
    /// By [`Quantity`].
    columns: [Option<usize>; 3],
}

impl Columns {
    /// Finds time and joints; columns of anything else are passed over.
    pub fn new<'a>(titles: impl Iterator<Item = &'a str>) -> Result<Self, String> {
        // NumPy marks the line as a comment.
        let titles: Vec<String> = titles
            .map(|t| t.trim_start_matches(['#', ' ']).to_owned())
            .collect();
        if titles.iter().all(|t| t.parse::<f64>().is_ok()) {
            return Err(format!(
                "no titles, the first line has numbers; it must name the columns, such as {EXAMPLE}"
            ));
        }
        let is_time = |title: &&String| TIME.iter().any(|t| title.eq_ignore_ascii_case(t));
        let times: Vec<&String> = titles.iter().filter(is_time).collect();
        let time = match times[..] {
            [_] => titles.iter().position(|t| is_time(&t)).unwrap_or_default(),
            [] => {
                let (time, there) = (TIME.join(", "), quoted(&titles));
                let hint = separated(&titles);
                return Err(format!(
                    "no column of the time ({time}); there are {there}{hint}"
                ));
            }
            [a, b, ..] => return Err(format!("columns {a:?} and {b:?} are both the time")),
        };
        let mut joints: Vec<Joint> = Vec::new();
        let mut known: HashMap<String, usize> = HashMap::new();
        for (k, title) in titles.iter().enumerate() {
            let Some((name, quantity)) = meaning(title)? else {
                continue;
            };
            let joint = *known.entry(name.clone()).or_insert(joints.len());
            if joint == joints.len() {
                let columns = [None; 3];
                joints.push(Joint { name, columns });
            }
            let joint = &mut joints[joint];
            if let Some(other) = joint.columns[quantity as usize].replace(k) {
                let (other, name, what) = (&titles[other], &joint.name, quantity.name());
                return Err(format!(
                    "columns {other:?} and {title:?} are both the {what} of joint {name:?}"
                ));
            }
        }
        if joints.is_empty() {
            let there = quoted(&titles);
            Err(format!(
                "no column of a joint, as in {EXAMPLE}; there are {there}"
            ))
        } else {
            Ok(Self {
                titles,
                time,
                joints,
            })
        }
    }

    /// The joints, by first columns.
    pub fn names(&self) -> Vec<String> {
        self.joints.iter().map(|joint| joint.name.clone()).collect()
    }

    pub fn time(&self) -> usize {
        self.time
    }

    pub fn title(&self, column: usize) -> &str {
        &self.titles[column]
    }

    /// The columns of all joints, where there are such.
    pub fn of(&self, quantity: Quantity) -> impl Iterator<Item = Option<usize>> {
        (self.joints.iter()).map(move |joint| joint.columns[quantity as usize])
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.titles.len()
    }

    /// The title of what is measured of a joint, or what is wrong if it has no such column.
    pub fn title_of(&self, joint: usize, quantity: Quantity) -> Result<&str, String> {
        let Joint { name, columns } = &self.joints[joint];
        match columns[quantity as usize] {
            Some(column) => Ok(self.title(column)),
            None => Err(format!(
                "joint {name:?} has no column of its {} ({}); there are {}",
                quantity.name(),
                quantity.titles(name),
                quoted(&self.titles)
            )),
        }
    }
}

/// Joint and quantity by the title of a column: `q_NAME`, `NAME.position` and the like, and `q1` of the first joint.
fn meaning(title: &str) -> Result<Option<(String, Quantity)>, String> {
    let words = Quantity::ALL.iter().flat_map(|quantity| {
        let words = quantity.words().iter();
        words.map(move |word| (*quantity, *word))
    });
    let found = words.flat_map(|(quantity, word)| {
        let names = [after(title, word), before(title, word)];
        names
            .into_iter()
            .flatten()
            .map(move |name| (name, quantity))
    });
    let found: Vec<(&str, Quantity)> = found.collect();
    match found[..] {
        [] => Ok(None),
        [(name, quantity)] => Ok(Some((plain(name).to_owned(), quantity))),
        [(a, of_a), (b, of_b), ..] => Err(format!(
            "column {title:?} may be the {} of joint {a:?} or the {} of joint {b:?}; rename it",
            of_a.name(),
            of_b.name()
        )),
    }
}

/// What follows a word, parted from it unless it is a number.
fn after<'a>(title: &'a str, word: &str) -> Option<&'a str> {
    let (start, rest) = title.split_at_checked(word.len())?;
    let name = rest.strip_prefix(BETWEEN);
    let name = name.or_else(|| is_number(rest).then_some(rest))?;
    (start.eq_ignore_ascii_case(word) && !name.is_empty()).then_some(name)
}

/// What a word follows, parted from it.
fn before<'a>(title: &'a str, word: &str) -> Option<&'a str> {
    let (rest, end) = title.split_at_checked(title.len().checked_sub(word.len())?)?;
    let name = rest.strip_suffix(BETWEEN)?;
    (end.eq_ignore_ascii_case(word) && !name.is_empty()).then_some(name)
}

fn is_number(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}

/// Numbers without leading zeros.
fn plain(name: &str) -> &str {
    if is_number(name) {
        match name.trim_start_matches('0') {
            "" => "0",
            digits => digits,
        }
    } else {
        name
    }
}

/// The names of joints that are numbered in the order of a robot with as many: from 0 if there is a 0, otherwise
/// from 1.
pub(crate) fn numbered(names: &[String], count: usize) -> Option<Vec<String>> {
    let numbers = names.iter().filter(|name| is_number(name));
    let first = usize::from(!names.iter().any(|name| name == "0"));
    let expected: Vec<String> = (first..first + count).map(|k| k.to_string()).collect();
    let is_whole = numbers.count() == count && expected.iter().all(|name| names.contains(name));
    is_whole.then_some(expected)
}

fn quoted(titles: &[String]) -> String {
    let titles: Vec<String> = titles.iter().map(|t| format!("{t:?}")).collect();
    crate::listed(&titles)
}

/// What may be wrong with the first line, where it has one title.
fn separated(titles: &[String]) -> &'static str {
    match titles {
        [one] if one.contains(';') => "; separate them by commas, with points in numbers",
        [one] if one.contains('\t') => "; call a file with tabs .tsv",
        [_] => "; the titles of the columns stand in the first line",
        _ => "",
    }
}
