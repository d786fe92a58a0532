//! What `--out` replaces, and what it leaves alone.

use crate::common::{Bench, METADATA, npy};
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

const SIMULATE: &str = "simulate data --field truth --out out";

/// What is measured cannot be computed again.
#[test]
fn measured_recordings_are_replaced_by_none() {
    let bench = Bench::new();
    let ids = ["a", "b", "c"].map(|id| format!("seq_{id}"));
    fs::create_dir(bench.root.join("out")).unwrap();
    for id in &ids {
        let folder = bench.root.join("out").join(id);
        fs::create_dir(&folder).unwrap();
        for name in ["angles.npy", "torques.npy"] {
            let from = bench.root.join("data").join(id).join(name);
            fs::copy(from, folder.join(name)).unwrap();
        }
    }
    let metadata = bench.root.join("out/dataset.json");
    let torques = bench.root.join("out/seq_a/torques.npy");
    let before = fs::read(&torques).unwrap();
    let predict = SIMULATE.replace("simulate", "predict") + " --sequences a,b,c";
    for made_by in ["", r#""made_by": "vsf import","#, r#""made_by": 1,"#] {
        fs::write(
            &metadata,
            METADATA.replacen('{', &format!("{{{made_by}"), 1),
        )
        .unwrap();
        for line in [SIMULATE, &predict] {
            bench.fails(line, 2, &["--out out", "choose a new folder, or remove"]);
        }
    }
    assert_eq!(fs::read(&torques).unwrap(), before);
    fs::remove_file(&metadata).unwrap();
    bench.fails(SIMULATE, 2, &["--out out", "other files"]);
    fs::remove_dir_all(bench.root.join("out")).unwrap();
    bench.ok(SIMULATE);
    bench.ok(&predict);
    // What is converted replaces nothing that was computed, nor the other way round, be it a simulation that comes back.
    bench.ok("export out --out out.mcap");
    for made_by in ["vsf predict", "vsf simulate"] {
        bench.fails("import out.mcap --out out", 2, &["--out out", made_by]);
        bench.ok(SIMULATE);
    }
    fs::remove_dir_all(bench.root.join("out")).unwrap();
    bench.ok("import out.mcap --out out");
    bench.ok("import out.mcap --out out");
    bench.fails(SIMULATE, 2, &["vsf import"]);
}

/// What a command has made it makes again, but not what a hand has set there since.
#[test]
fn edited_recordings_are_replaced_by_none() {
    let bench = Bench::new();
    let metadata = bench.root.join("out/dataset.json");
    bench.ok(SIMULATE);
    bench.ok("export out --out out.mcap");
    for (line, command) in [
        (SIMULATE, "vsf simulate"),
        ("import out.mcap --out out", "vsf import"),
    ] {
        let _ = fs::remove_dir_all(bench.root.join("out"));
        bench.ok(line);
        let written = fs::read_to_string(&metadata).unwrap();
        let edited = written.replacen('{', r#"{"touch_starts": {"b": [3]},"#, 1);
        fs::write(&metadata, &edited).unwrap();
        bench.fails(line, 2, &["edited since", command, "choose a new folder"]);
        assert_eq!(fs::read_to_string(&metadata).unwrap(), edited);
        // Blanks are no edit, nor are files of others.
        fs::write(&metadata, written.replace("  ", "\t")).unwrap();
        fs::write(bench.root.join("out/notes.txt"), "mine").unwrap();
        bench.ok(line);
        let torques = bench.root.join("out/seq_b/torques.npy");
        let mut bytes = fs::read(&torques).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(&torques, &bytes).unwrap();
        bench.fails(line, 2, &["edited since", command]);
        assert_eq!(fs::read(&torques).unwrap(), bytes);
        assert_eq!(fs::read(bench.root.join("out/notes.txt")).unwrap(), b"mine");
    }
}

/// Deviations are those of the torques beside them.
#[test]
fn predictions_leave_nothing_behind() {
    let bench = Bench::new();
    let deviations = bench.root.join("out/seq_a/torques_sd.npy");
    bench.ok("predict data --field truth --sequences a,b,c --out out");
    assert!(deviations.exists());
    bench.ok(SIMULATE);
    assert!(!deviations.exists());
}

#[cfg(unix)]
#[test]
fn predictions_that_stay_keep_their_deviations() {
    let bench = Bench::new();
    let at = |name: &str| bench.root.join(name);
    bench.ok("predict data --field truth --sequences a,b,c --out out");
    // No link is written to.
    let link = at("out/seq_c/time.npy");
    fs::rename(&link, at("time.npy")).unwrap();
    std::os::unix::fs::symlink(at("time.npy"), &link).unwrap();
    bench.fails(SIMULATE, 2, &["seq_c/time.npy", "link"]);
    assert!(at("out/seq_a/torques_sd.npy").exists());
}

/// What was set by hand in a field is not estimated again.
#[test]
fn edited_fields_are_replaced_by_none() {
    let bench = Bench::touched();
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out field";
    bench.ok(estimate);
    bench.ok(estimate);
    let path = bench.root.join("field/K.npy");
    npy(&path, &[160], &[3.0; 160]);
    let mine = fs::read(&path).unwrap();
    for line in [estimate, "export touch --field truth --out field"] {
        bench.fails(line, 2, &["--out field", "edited"]);
    }
    assert_eq!(fs::read(&path).unwrap(), mine);
}

/// What an output replaces is of its own kind, as vsf writes it.
#[test]
fn files_of_another_kind_are_replaced_by_none() {
    let bench = Bench::touched();
    let at = |name: &str| bench.root.join(name);
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out";
    let mesh = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 0\n";
    let page = "<!DOCTYPE html>\n<html><body>mine</body></html>\n";
    for (line, out, theirs) in [
        (estimate, "a.npz", mesh),
        (estimate, "a.ply", mesh),
        (estimate, "a.mcap", mesh),
        ("export truth --out", "a.png", mesh),
        ("export truth --out", "a.svg", page),
        (
            "export truth --out",
            "b.svg",
            "<svg><!-- vsf as drawn by me --></svg>",
        ),
        ("view truth --out", "a.html", page),
        ("diagnose touch --html", "b.html", page),
        ("diagnose touch --model", "model.json", "{\"mine\": 1}"),
        (
            "diagnose touch --model",
            "by_hand.json",
            "{\"schema\": 1, \"effects\": []}",
        ),
        ("info touch --json", "info.json", "{\"mine\": 1}"),
        ("info touch --json", "notes.txt", "mine"),
    ] {
        let line = format!("{line} {out}");
        fs::write(at(out), theirs).unwrap();
        bench.fails(&line, 2, &[out, "holds something else"]);
        assert_eq!(fs::read_to_string(at(out)).unwrap(), theirs, "{line}");
        // Nothing is lost with an empty file, nor with what the same command wrote.
        fs::write(at(out), "").unwrap();
        bench.ok(&line);
        bench.ok(&line);
    }
}

/// Files of the same format by other programs are theirs: what vsf writes bears its mark.
#[test]
fn files_without_the_mark_are_replaced_by_none() {
    let bench = Bench::touched();
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out";
    for (line, out, mark) in [
        (estimate, "a.npz", "vsf "),
        (estimate, "a.ply", "comment vsf "),
        (estimate, "a.mcap", "vsf "),
        ("export truth --out", "a.png", "Software\0vsf "),
        ("export truth --out", "a.svg", "<!-- vsf "),
        ("export touch --field truth --out", "b.mcap", "vsf "),
        ("view truth --out", "a.html", "content=\"vsf "),
        ("info touch --json", "info.json", "\"made_by\": \"vsf "),
    ] {
        let line = format!("{line} {out}");
        bench.ok(&line);
        let path = bench.root.join(out);
        let theirs = without(&fs::read(&path).unwrap(), mark.as_bytes());
        fs::write(&path, &theirs).unwrap();
        bench.fails(&line, 2, &[out, "something else", "new file, or delete"]);
        assert!(fs::read(&path).unwrap() == theirs, "{line}");
    }
}

/// The same bytes, but for the letters of a mark.
fn without(bytes: &[u8], mark: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let places = (0..bytes.len()).filter(|i| bytes[*i..].starts_with(mark));
    let places: Vec<usize> = places.collect();
    assert!(!places.is_empty());
    for place in places {
        let letters = place..place + mark.len();
        bytes[letters].make_ascii_uppercase();
    }
    bytes
}

/// The file that a link leads to is another's.
#[cfg(unix)]
#[test]
fn links_in_outputs_are_not_followed() {
    use std::os::unix::fs::symlink;
    let bench = Bench::touched();
    bench.ok(SIMULATE);
    bench.ok("export out --field truth --out out.mcap");
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out fold";
    let plots = "export touch --field truth --torques plots";
    bench.ok(estimate);
    bench.ok(plots);
    let at = |name: &str| bench.root.join(name);
    let simulated = [
        SIMULATE,
        "predict data --field truth --sequences a,b,c --out out",
    ];
    let import = "import out.mcap --out back";
    bench.ok(import);
    let cases: [(&[&str], &str, &str); 9] = [
        (&[import], "back/seq_a", "touch/seq_a"),
        (
            &[import],
            "back/seq_a/torques.npy",
            "touch/seq_a/torques.npy",
        ),
        (&simulated, "out/seq_a", "touch/seq_a"),
        (&simulated, "out/points.npy", "touch/points.npy"),
        (
            &simulated,
            "out/seq_a/torques.npy",
            "touch/seq_a/torques.npy",
        ),
        (&simulated, "out/dataset.json", "touch/dataset.json"),
        (&simulated, "out/dataset.json", "touch/nowhere"),
        (&[estimate], "fold/points.npy", "touch/points.npy"),
        (&[plots], "plots/torques_c.svg", "out.mcap"),
    ];
    for (lines, link, target) in cases {
        let kept = bench.root.join("kept");
        fs::rename(at(link), &kept).unwrap();
        symlink(at(target), at(link)).unwrap();
        let before = contents(&bench.root);
        for line in lines {
            bench.fails(line, 2, &[link, "is a link"]);
            assert!(contents(&bench.root) == before, "{line}");
        }
        fs::remove_file(at(link)).unwrap();
        fs::rename(&kept, at(link)).unwrap();
    }
    // The output itself may be one.
    fs::rename(at("out"), at("elsewhere")).unwrap();
    symlink("elsewhere", at("out")).unwrap();
    bench.ok(SIMULATE);
    assert!(at("out").is_symlink() && at("elsewhere/seq_a").is_dir());
}

/// A killed process leaves a folder without the file that is written last; nothing takes it for a recording or field.
#[test]
fn interrupted_writes_are_told_and_repeated() {
    let bench = Bench::touched();
    let at = |name: &str| bench.root.join(name);
    bench.ok(SIMULATE);
    let left = at("out/.vsf-abcdef.part");
    fs::rename(at("out/dataset.json"), &left).unwrap();
    fs::remove_file(at("out/points.npy")).unwrap();
    for line in ["info out", "info out --robot cartesian_stage --rate-hz 50"] {
        bench.fails(line, 1, &["out", "interrupted", "write it again"]);
    }
    bench.ok(SIMULATE);
    bench.ok("info out");
    // What is left is that of a killed process once nobody can be writing it.
    assert!(left.exists());
    let file = fs::File::options().write(true).open(&left).unwrap();
    file.set_modified(SystemTime::now() - Duration::from_secs(7200))
        .unwrap();
    bench.ok(SIMULATE);
    assert!(!left.exists());

    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out fold";
    bench.ok(estimate);
    fs::rename(at("fold/points.npy"), at("fold/.vsf-abcdef.part")).unwrap();
    bench.fails("export fold --out a.ply", 1, &["fold", "interrupted"]);
    bench.ok(estimate);
    bench.ok("export fold --out a.ply");
}

/// All files below a folder, with what is in them.
fn contents(folder: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(contents(&path))
        } else {
            all.push((path.clone(), fs::read(&path).unwrap_or_default()))
        }
    }
    all.sort();
    all
}

/// A recording in the place of the quick start's may be somebody's.
#[test]
fn the_quick_start_replaces_its_own_alone() {
    let bench = Bench::new();
    let place = bench.root.join("vsf-quickstart/recording");
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree/seq_000");
    fs::create_dir_all(place.join("seq_000")).unwrap();
    let torques = place.join("seq_000/torques.npy");
    fs::write(&torques, "mine").unwrap();
    bench.fails(
        "",
        2,
        &["seq_000/torques.npy", "not as the quick start writes it"],
    );
    assert_eq!(fs::read_to_string(&torques).unwrap(), "mine");
    fs::copy(format!("{own}/torques.npy"), &torques).unwrap();
    fs::create_dir(place.join("seq_002")).unwrap();
    bench.fails("", 2, &["seq_002", "not as the quick start writes it"]);
    fs::remove_dir(place.join("seq_002")).unwrap();
    let svg = bench.root.join("vsf-quickstart/torques.svg");
    fs::write(&svg, "mine").unwrap();
    bench.fails("", 2, &["torques.svg", "holds something else"]);
    assert_eq!(fs::read_to_string(&svg).unwrap(), "mine");
}

#[test]
fn plots_replace_plots_alone() {
    let bench = Bench::touched();
    fs::create_dir(bench.root.join("plots")).unwrap();
    let plot = bench.root.join("plots/torques_c.svg");
    fs::write(&plot, "mine").unwrap();
    let line = "export touch --field truth --torques plots";
    bench.fails(line, 2, &["torques_c.svg", "holds something else"]);
    assert_eq!(fs::read_to_string(&plot).unwrap(), "mine");
    fs::remove_file(&plot).unwrap();
    bench.ok(line);
    bench.ok(line);
}
