//! The report of `vsf experiment paper` as Markdown.

use super::figures::{Figures, file_stem};
use super::paper::Entry;
use super::table1;
use vsf::pipeline::{Overlap, UpdateTimes};

/// Tables I to V and the numbers of Figs. 4 and 7, as Markdown.
pub fn tables(entries: &[Entry], update_times: &[UpdateTimes]) -> String {
    let mut text = "\
## Recordings

Overlap is told from contacts: the share of a sequence's contacts on points that another one touches, the
least of all pairs, and on points that any other touches, the median. Sequences that touch nothing have no part in it. The
threshold is that of contact.

| recording | overlap | least pair | with all others | train | test | threshold [mm] |
| --- | --- | --- | --- | --- | --- | --- |
"
    .to_owned();
    for e in entries {
        let test = if e.leave_one_out {
            format!("each of {} in turn", e.test_sequences)
        } else {
            e.test_sequences.to_string()
        };
        text += &format!(
            "| {} | {} | {:.2} | {:.2} | {} | {test} | {:.2} |\n",
            e.recording,
            e.overlap,
            e.shares.least_pair,
            e.shares.with_all,
            e.train_sequences,
            1e3 * e.threshold
        );
    }
    text += "
## Table I: with and without memory replay

By the train and test split of each recording, also where Tables IV and V test on every sequence in turn. Where the paper has
its equation (7), variances that replays shrink, a buffer for each sequence, and equation (5) with means set to zero, here the
diagonal filter takes the whole innovation, replays keep variances, the buffer keeps past sequences, and the exact filter has
the constrained mean.

";
    text += &table1::text(entries.iter().map(|e| &e.table1));
    text += "
## Table II: update speed

Kinematics, contact and diagonal filter with 20 replays on one thread, over the samples in contact.

| recording | contacts | updates a second |
| --- | --- | --- |
";
    for e in entries {
        let (contacts, rate) = (e.update_speed.contacts, e.update_speed.rate_hz);
        text += &format!(
            "| {} | {:.0} ± {:.0} | {:.0} ± {:.0} |\n",
            e.recording, contacts.mean, contacts.sd, rate.mean, rate.sd
        );
    }
    for (title, overlap) in [
        ("Table III: FULL overlap", Overlap::Full),
        ("Table IV: PARTIAL overlap", Overlap::Partial),
        ("Table V: NO overlap", Overlap::No),
    ] {
        let of_table: Vec<_> = entries.iter().filter(|e| e.overlap == overlap).collect();
        text += &errors_table(title, &of_table);
    }
    text += &curves(entries);
    text + &update_time_table(update_times)
}

/// Mean and deviation of the error of every method.
fn errors_table(title: &str, entries: &[&Entry]) -> String {
    let Some(widest) = entries.iter().max_by_key(|e| e.errors.len()) else {
        return String::new();
    };
    let methods: Vec<_> = widest.errors.iter().map(|e| e.method).collect();
    let mut text = format!(
        "\n## {title}\n\nMean ± standard deviation of ||tau_hat - tau|| over the samples of the test sequences.\n\n\
         | recording |"
    );
    methods
        .iter()
        .for_each(|m| text += &format!(" {} |", m.name()));
    text += &format!("\n| --- |{}\n", " --- |".repeat(methods.len()));
    for entry in entries {
        text += &format!("| {} [{}] |", entry.recording, entry.unit);
        for method in &methods {
            text += &match entry.errors.iter().find(|e| e.method == *method) {
                None => " no camera |".to_owned(),
                Some(e) => {
                    let e = &e.evaluation;
                    format!(" {:.2} ± {:.2} |", e.mean_error, e.sd_error)
                }
            };
        }
        text += "\n";
    }
    text
}

/// The numbers of Fig. 7.
fn curves(entries: &[Entry]) -> String {
    let mut text = String::new();
    for entry in entries.iter().filter(|e| !e.curve.is_empty()) {
        let methods: Vec<_> = entry.errors.iter().map(|e| e.method).collect();
        text += &format!(
            "\n## Fig. 7: error against the number of train sequences, {} [{}]\n\n| train sequences |",
            entry.recording, entry.unit
        );
        methods
            .iter()
            .for_each(|m| text += &format!(" {} |", m.name()));
        text += &format!("\n| --- |{}\n", " --- |".repeat(methods.len()));
        for place in &entry.curve {
            text += &format!("| {} |", place.sequences);
            for e in &place.errors {
                text += &format!(" {:.2} |", e.evaluation.mean_error);
            }
            text += "\n";
        }
    }
    text
}

/// The numbers of Fig. 4.
fn update_time_table(stages: &[UpdateTimes]) -> String {
    let mut text = "
## Fig. 4: time of an update against the number of contacts

Medians [ms] over a push of a Kinova Gen3 into a cube of 97,336 points.

| contacts |"
        .to_owned();
    stages
        .iter()
        .for_each(|s| text += &format!(" {} |", s.stage));
    text += &format!("\n| --- |{}\n", " --- |".repeat(stages.len()));
    let rows = stages.first().map_or(0, |s| s.times.len());
    for row in 0..rows {
        let contacts = stages.first().map_or(0.0, |s| s.times[row].contacts);
        text += &format!("| {contacts:.0} |");
        for stage in stages {
            text += &format!(" {:.3} |", stage.times[row].median_ms);
        }
        text += "\n";
    }
    text + "\n"
}

/// Links to the figures.
pub fn figures_text(entries: &[Entry]) -> String {
    let mut text = format!("![Fig. 4]({})\n", Figures::UPDATE_TIMES);
    for entry in entries.iter().filter(|e| !e.curve.is_empty()) {
        let stem = file_stem(entry.number, &entry.recording);
        text += &format!("\n![Fig. 7, {}]({stem}_curve.svg)\n", entry.recording);
    }
    text += "\n## Fig. 5: fields, by touch alone and with vision\n";
    for entry in entries {
        text += &format!("\n{}\n\n", entry.recording);
        for picture in &entry.fields {
            text += &format!("![{picture}]({picture})\n");
        }
    }
    text
}
