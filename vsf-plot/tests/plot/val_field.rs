//! Field pictures against what must be seen in them.

use nalgebra::Point3;
use vsf_plot::{ColorLimit, FieldView};

struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

fn decode(file: &[u8]) -> Picture {
    let mut reader = png::Decoder::new(std::io::Cursor::new(file))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(
        (info.color_type, info.bit_depth),
        (png::ColorType::Rgb, png::BitDepth::Eight)
    );
    Picture {
        width: info.width as usize,
        height: info.height as usize,
        pixels: bytes.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}

/// The inner parts of the three panels: three-quarter, top and side view.
const PANELS: [[usize; 4]; 3] = [
    [200, 150, 760, 780],
    [970, 160, 1400, 460],
    [970, 605, 1400, 875],
];

impl Picture {
    fn count(&self, [x0, y0, x1, y1]: [usize; 4], wanted: impl Fn([i32; 3]) -> bool) -> usize {
        (y0..y1)
            .flat_map(|y| (x0..x1).map(move |x| (x, y)))
            .filter(|&(x, y)| wanted(self.pixels[y * self.width + x].map(i32::from)))
            .count()
    }
}

/// The dark violet end of the color map; ink and gray are not blue enough.
fn stiff([r, g, b]: [i32; 3]) -> bool {
    r < 120 && g < 80 && b > g + 20
}

fn pale([r, g, b]: [i32; 3]) -> bool {
    r > b + 8 && g > 130
}

fn cube(side: i32) -> Vec<Point3<f64>> {
    let at = |i: i32| 0.01 * f64::from(i);
    (0..side)
        .flat_map(|i| (0..side).flat_map(move |j| (0..side).map(move |k| (i, j, k))))
        .map(|(i, j, k)| Point3::new(0.4 + at(i), at(j), at(k)))
        .collect()
}

fn distance_from_center(points_W: &[Point3<f64>]) -> Vec<f64> {
    let sum = points_W
        .iter()
        .map(|p| p.coords)
        .sum::<nalgebra::Vector3<f64>>();
    let center = Point3::from(sum / points_W.len() as f64);
    points_W
        .iter()
        .map(|p| nalgebra::distance(p, &center))
        .collect()
}

#[test]
fn a_stiff_core_shows_through_the_soft_cloud_in_every_panel() {
    let points_W = cube(20);
    let stiffness: Vec<f64> = distance_from_center(&points_W)
        .iter()
        .map(|&d| if d < 0.03 { 300.0 } else { 10.0 })
        .collect();
    let view = FieldView {
        points_W: &points_W,
        stiffness: &stiffness,
        limit: ColorLimit::Value(300.0),
        ..FieldView::default()
    };
    let picture = decode(&view.png().unwrap());
    assert_eq!((picture.width, picture.height), (1600, 960));
    assert_eq!((FieldView::WIDTH, FieldView::HEIGHT), (1600, 960));
    // The core's cross section is at least pi 0.025^2 of the face 0.2^2, 4.9 %.
    let soft_only = decode(
        &FieldView {
            stiffness: &vec![10.0; 8000],
            ..view
        }
        .png()
        .unwrap(),
    );
    for panel in PANELS {
        let dark = picture.count(panel, stiff);
        assert_eq!(soft_only.count(panel, stiff), 0, "{panel:?}");
        let face = soft_only.count(panel, pale);
        assert!(
            dark > face / 30 && dark < face / 4,
            "{panel:?}: {dark} of {face}"
        );
    }
}

#[test]
fn untouched_points_have_no_stiffness_color() {
    let points_W = cube(8);
    let stiffness = vec![500.0; points_W.len()];
    let touched = vec![false; points_W.len()];
    let view = FieldView {
        points_W: &points_W,
        stiffness: &stiffness,
        touched: &touched,
        ..FieldView::default()
    };
    let picture = decode(&view.png().unwrap());
    for panel in PANELS {
        assert_eq!(picture.count(panel, stiff), 0);
        // Gray only: no channel differs much from another.
        let colored = |[r, g, b]: [i32; 3]| r.max(g).max(b) - r.min(g).min(b) > 20;
        assert_eq!(picture.count(panel, colored), 0);
    }
    assert!(view.svg().unwrap().contains("none of 512 points touched"));
}

#[test]
fn surface_colors_and_robot_are_drawn_behind_the_field() {
    let points_W = [Point3::new(0.5, 0.0, 0.1)];
    let context_W = cube(8);
    let red = vec![[255, 0, 0]; context_W.len()];
    let robot_W = [vec![
        Point3::new(0.4, 0.0, 0.0),
        Point3::new(0.45, 0.05, 0.05),
    ]];
    let view = FieldView {
        points_W: &points_W,
        stiffness: &[100.0],
        context_W: &context_W,
        context_colors: &red,
        robot_W: &robot_W,
        ..FieldView::default()
    };
    let picture = decode(&view.png().unwrap());
    for panel in PANELS {
        assert!(picture.count(panel, |[r, g, b]| r > g.max(b) + 50 && g == b) > 100);
        assert!(picture.count(panel, |[r, _, b]| b > 190 && b > r + 50) > 100);
        assert!(picture.count(panel, stiff) > 10);
    }
}

#[test]
fn the_bar_states_quantile_and_clipped_points() {
    let points_W = cube(10);
    let stiffness: Vec<f64> = (0..1000).map(|i| f64::from(i + 1)).collect();
    let view = FieldView {
        points_W: &points_W,
        stiffness: &stiffness,
        ..FieldView::default()
    };
    let svg = view.svg().unwrap();
    for words in [
        "top end 990:",
        "99 % quantile",
        "10 above,",
        "up to 1000",
        "stiffness [N/m]",
    ] {
        assert!(svg.contains(words), "{words}");
    }
}

#[test]
fn equal_input_gives_equal_bytes() {
    let points_W = cube(6);
    let stiffness = distance_from_center(&points_W);
    let view = FieldView {
        points_W: &points_W,
        stiffness: &stiffness,
        ..FieldView::default()
    };
    assert_eq!(view.png().unwrap(), view.png().unwrap());
    assert_eq!(view.svg().unwrap(), view.svg().unwrap());
}

#[test]
fn a_million_points() {
    let points_W = cube(100);
    let stiffness: Vec<f64> = (0..points_W.len()).map(|i| (i % 997) as f64).collect();
    let view = FieldView {
        points_W: &points_W,
        stiffness: &stiffness,
        context_W: &points_W[..10_000],
        ..FieldView::default()
    };
    assert_eq!(decode(&view.png().unwrap()).width, 1600);
    let svg = view.svg().unwrap();
    assert!(svg.len() < 5_000_000, "{} bytes", svg.len());
    assert!(svg.contains("the 12000 largest are drawn"));
}
