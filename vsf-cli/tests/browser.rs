//! What `vsf view` and `vsf diagnose --html` write, drawn by a headless Chromium. Skipped, and said so, where there
//! is none; `CHROMIUM` names one that is not found.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;
use common::Bench;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

const NAMES: [&str; 5] = [
    "chromium-headless-shell",
    "/usr/lib/chromium/chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
];

fn browser() -> Option<String> {
    let named = std::env::var("CHROMIUM").ok();
    let names = named.into_iter().chain(NAMES.map(str::to_owned));
    let runs = |name: &String| {
        let version = Command::new(name).arg("--version").output();
        version.is_ok_and(|o| o.status.success())
    };
    names.into_iter().find(runs)
}

/// How many pixels of a screenshot have each colour.
struct Colours(BTreeMap<[u8; 3], usize>);

impl Colours {
    /// Of a page in a window of this size, which must not report an error.
    fn of(browser: &str, page: &Path, (width, height): (u32, u32)) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let shot = profile.path().join("shot.png");
        let out = Command::new(browser)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--hide-scrollbars",
            ])
            .args(["--enable-logging=stderr", "--virtual-time-budget=4000"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--window-size={width},{height}"))
            .arg(format!("--screenshot={}", shot.display()))
            .arg(format!("file://{}", page.display()))
            .output()
            .unwrap();
        let log = String::from_utf8_lossy(&out.stderr);
        assert!(
            !log.contains("Uncaught") && !log.contains("Refused to"),
            "{log}"
        );
        let file = fs::File::open(&shot).unwrap_or_else(|e| panic!("no screenshot: {e}: {log}"));
        let mut reader = png::Decoder::new(std::io::BufReader::new(file))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (width, height));
        let mut colours = BTreeMap::new();
        for p in pixels.chunks_exact(info.color_type.samples()) {
            *colours.entry([p[0], p[1], p[2]]).or_insert(0) += 1;
        }
        Self(colours)
    }

    fn count(&self, such: impl Fn([u8; 3]) -> bool) -> usize {
        let those = self.0.iter().filter(|(c, _)| such(**c));
        those.map(|(_, n)| n).sum()
    }
}

/// Neither grey nor nearly so, as texts and frames are.
fn is_colourful(c: [u8; 3]) -> bool {
    c.iter().max().unwrap() - c.iter().min().unwrap() > 60
}

#[test]
fn pages_are_drawn_at_two_widths() {
    let Some(browser) = browser() else {
        eprintln!("SKIPPED: no Chromium; set CHROMIUM to one to test how pages are drawn");
        return;
    };
    let bench = Bench::touched();
    bench.ok("estimate touch --out field.npz");
    bench.ok("view touch --field field.npz --out touch.html");
    bench.ok("view field.npz --out field.html");
    for size in [(1200, 800), (420, 800)] {
        for page in ["touch.html", "field.html"] {
            let colours = Colours::of(&browser, &bench.root.join(page), size);
            let all = (size.0 * size.1) as usize;
            // The cloud in its colour map, on an even ground.
            let colourful = colours.count(is_colourful);
            assert!(
                colourful > all / 200,
                "{page} {size:?}: {colourful} of {all}"
            );
            assert!(
                colours.0.len() > 50,
                "{page} {size:?}: {} colours",
                colours.0.len()
            );
        }
    }
    let text = bench.root.join("text.html");
    fs::write(&text, "<h1>field</h1>").unwrap();
    let colours = Colours::of(&browser, &text, (420, 800));
    assert_eq!(colours.count(is_colourful), 0);
}
