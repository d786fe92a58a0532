//! What `vsf view` and `vsf diagnose --html` write, drawn by a headless Chromium. Skipped, and said so, where there
//! is none; `CHROMIUM` names one that is not found.

use crate::common::Bench;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

const NAMES: [&str; 5] = [
    "chromium-headless-shell",
    "/usr/lib/chromium/chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
];

/// What a change of the page's program, from one text to the other, changes in the picture.
const CHANGES: [(&str, &str, &str); 5] = [
    ("no points", "drawCloud(l, moved);", ""),
    ("the deviations", "let layer = 0", "let layer = 1"),
    ("another side", "azimuth: -60", "azimuth: 60"),
    ("no robot", "drawRobot(l, t.poses, first);", ";"),
    (
        "a later sample",
        "sample = Math.max(0,",
        "sample = 12 + Math.max(0,",
    ),
];
/// Those that a field alone has.
const OF_FIELD: usize = 3;

fn browser() -> Option<String> {
    let named = std::env::var("CHROMIUM").ok();
    let names = named.into_iter().chain(NAMES.map(str::to_owned));
    let runs = |name: &String| {
        let version = Command::new(name).arg("--version").output();
        version.is_ok_and(|o| o.status.success())
    };
    names.into_iter().find(runs)
}

/// A browser without a screen, with a window of this size.
fn headless(browser: &str, (width, height): (u32, u32)) -> Command {
    let mut command = Command::new(browser);
    command
        .args(["--headless", "--no-sandbox", "--disable-gpu"])
        .args(["--hide-scrollbars", "--virtual-time-budget=4000"])
        .arg(format!("--window-size={width},{height}"));
    command
}

/// A screenshot, as rows of pixels.
struct Shot(Vec<Vec<[u8; 3]>>);

impl Shot {
    /// Of a page in a window of this size, and what the console says.
    fn of(browser: &str, page: &Path, window: (u32, u32)) -> (Self, String) {
        let profile = tempfile::tempdir().unwrap();
        let shot = profile.path().join("shot.png");
        let out = headless(browser, window)
            .arg("--enable-logging=stderr")
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--screenshot={}", shot.display()))
            .arg(format!("file://{}", page.display()))
            .output()
            .unwrap();
        let log = String::from_utf8_lossy(&out.stderr);
        let file = fs::File::open(&shot).unwrap_or_else(|e| panic!("no screenshot: {e}: {log}"));
        let mut reader = png::Decoder::new(std::io::BufReader::new(file))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), window);
        let samples = info.color_type.samples();
        let rows = pixels.chunks_exact(window.0 as usize * samples);
        let row = |r: &[u8]| {
            r.chunks_exact(samples)
                .map(|p| [p[0], p[1], p[2]])
                .collect()
        };
        let console = log.lines().filter(|l| l.contains("CONSOLE"));
        (Self(rows.map(row).collect()), console.collect())
    }

    /// Pixels that differ between two screenshots of one size.
    fn differs(&self, other: &Self) -> usize {
        let rows = self.0.iter().zip(&other.0);
        rows.map(|(a, b)| a.iter().zip(b).filter(|(a, b)| a != b).count())
            .sum()
    }
}

/// Two numbers that a page computes in a window of this size.
fn measured(
    browser: &str,
    bench: &Bench,
    page: &str,
    window: (u32, u32),
    numbers: &str,
) -> (f64, f64) {
    let script = format!("<script>document.title = {numbers}.join(' ')</script></body>");
    let page = changed(bench, page, "</body>", &script);
    // Pages without a program of their own allow none.
    let free = fs::read_to_string(&page)
        .unwrap()
        .replace("http-equiv", "name");
    fs::write(&page, free).unwrap();
    let out = headless(browser, window)
        .arg("--dump-dom")
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&out.stdout);
    let title = text
        .split_once("<title>")
        .unwrap()
        .1
        .split_once('<')
        .unwrap()
        .0;
    let mut numbers = title.split(' ').map(|n| n.parse().unwrap());
    (numbers.next().unwrap(), numbers.next().unwrap())
}

/// The page with another program.
fn changed(bench: &Bench, page: &str, from: &str, to: &str) -> PathBuf {
    let whole = fs::read_to_string(bench.root.join(page)).unwrap();
    assert_eq!(whole.matches(from).count(), 1, "{from} in {page}");
    let path = bench.root.join("changed.html");
    fs::write(&path, whole.replace(from, to)).unwrap();
    path
}

#[test]
fn pages_are_drawn_at_two_widths() {
    let Some(browser) = browser() else {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: no Chromium; set CHROMIUM to one to test how pages are drawn"
        );
        return;
    };
    let bench = Bench::touched();
    bench.ok("estimate touch --out field.npz");
    bench.ok("view touch --field field.npz --out touch.html");
    bench.ok("view field.npz --out field.html");
    bench.ok("diagnose touch --effects torque_bias --html gap.html");
    for size in [(1200, 800), (420, 800)] {
        let drawn = |page: &Path| {
            let (shot, console) = Shot::of(&browser, page, size);
            assert_eq!(console, "", "{}", page.display());
            shot
        };
        for (page, changes) in [
            ("touch.html", &CHANGES[..]),
            ("field.html", &CHANGES[..OF_FIELD]),
        ] {
            let whole = drawn(&bench.root.join(page));
            for (what, from, to) in changes {
                let pixels = whole.differs(&drawn(&changed(&bench, page, from, to)));
                assert!(
                    pixels > 500,
                    "{page} {size:?}: {what} changes {pixels} pixels"
                );
            }
        }
        // A page without a program: words and bars.
        let gap = drawn(&bench.root.join("gap.html"));
        let blank = bench.root.join("blank.html");
        fs::write(&blank, "").unwrap();
        assert!(gap.differs(&drawn(&blank)) > 5000, "{size:?}");
        for page in ["touch.html", "field.html", "gap.html"] {
            let widths = "[document.documentElement.scrollWidth, innerWidth]";
            let (width, window) = measured(&browser, &bench, page, size, widths);
            assert!(width <= window, "{page} is {width} wide in {window}");
        }
    }
    // The plot is seen whole, its time axis included.
    let (bottom, window) = measured(
        &browser,
        &bench,
        "gap.html",
        (1200, 1000),
        "[document.querySelector('.plot').getBoundingClientRect().bottom, innerHeight]",
    );
    assert!(bottom <= window, "the plot ends at {bottom} of {window}");
    // Untouched points are hidden, and the view is that of the others.
    let numbers = "[camera.distance, 3.11 * focus.radius, bounds.radius, focus.radius]";
    let (distance, most) = measured(&browser, &bench, "field.html", (1200, 800), numbers);
    assert!(distance < most, "{distance} m away, not {most}");
    // What the console says is heard.
    let foreign = bench.root.join("foreign.html");
    let page = fs::read_to_string(bench.root.join("gap.html")).unwrap();
    fs::write(&foreign, page + "<img src=\"http://127.0.0.1:9/x.png\">").unwrap();
    let (_, console) = Shot::of(&browser, &foreign, (420, 800));
    assert!(console.contains("Content Security Policy"), "{console}");
}
