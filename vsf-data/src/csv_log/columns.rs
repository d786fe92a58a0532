//! Meaning of columns by their titles.

use std::collections::HashMap;

/// Titles of the time column \[s\].
const TIME: [&str; 4] = ["time", "t", "timestamp", "time_s"];

/// Separators between a word and the name of a joint.
const BETWEEN: [char; 3] = ['_', '.', '/'];

/// Example of valid titles.
const EXAMPLE: &str = "time, q_NAME, tau_NAME";

/// Measured quantity of a joint.
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

    /// Words for it in titles.
    fn words(self) -> &'static [&'static str] {
        match self {
            Self::Position => &["position", "pos", "q"],
            Self::Velocity => &["velocity", "vel", "dq", "qd"],
            Self::Effort => &["effort", "torque", "tau"],
        }
    }

    /// The titles by which a column may hold it for a joint.
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
    /// Finds the columns of time and joints. All other columns are ignored.
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

    /// Names of the joints, in the order of their first columns.
    pub fn names(&self) -> Vec<String> {
        self.joints.iter().map(|joint| joint.name.clone()).collect()
    }

    pub fn time(&self) -> usize {
        self.time
    }

    pub fn title(&self, column: usize) -> &str {
        &self.titles[column]
    }

    /// The column of each joint, if it has one.
    pub fn of(&self, quantity: Quantity) -> impl Iterator<Item = Option<usize>> {
        (self.joints.iter()).map(move |joint| joint.columns[quantity as usize])
    }

    /// Number of columns.
    pub fn count(&self) -> usize {
        self.titles.len()
    }

    /// The title of the column for a quantity of a joint, or what is wrong if there is none.
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

/// Joint and quantity of a column by its title: `q_NAME`, `NAME.position` and the like, and `q1` for the first joint.
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

/// What follows a word in a title. A separator must stand between the two, unless a number follows.
fn after<'a>(title: &'a str, word: &str) -> Option<&'a str> {
    let (start, rest) = title.split_at_checked(word.len())?;
    let name = rest.strip_prefix(BETWEEN);
    let name = name.or_else(|| is_number(rest).then_some(rest))?;
    (start.eq_ignore_ascii_case(word) && !name.is_empty()).then_some(name)
}

/// What precedes a word in a title, up to the separator.
fn before<'a>(title: &'a str, word: &str) -> Option<&'a str> {
    let (rest, end) = title.split_at_checked(title.len().checked_sub(word.len())?)?;
    let name = rest.strip_suffix(BETWEEN)?;
    (end.eq_ignore_ascii_case(word) && !name.is_empty()).then_some(name)
}

fn is_number(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}

/// A number without leading zeros.
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

/// The names of numbered joints, in the order of a robot with `count` joints: from 0 if there is a 0, otherwise from 1.
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

/// Hint on what may be wrong with the first line if it has only one title.
fn separated(titles: &[String]) -> &'static str {
    match titles {
        [one] if one.contains(';') => "; separate them by commas, with points in numbers",
        [one] if one.contains('\t') => "; call a file with tabs .tsv",
        [_] => "; the titles of the columns stand in the first line",
        _ => "",
    }
}
