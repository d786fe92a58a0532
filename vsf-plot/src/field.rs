use crate::color::{ColorLimit, Rgb};
use crate::error::{check_len, check_values};
use crate::raster::Raster;
use crate::scene::Scene;
use crate::vector::{Vector, svg_file};
use crate::{PlotError, layout};
use nalgebra::Point3;

/// Largest magnitude of a coordinate \[m\].
const FAR: f64 = 1e6;
/// Largest stiffness \[N/m\].
const STIFF: f64 = 1e15;

/// A picture of a stiffness field: a three-quarter view, a top view and a side view, with a
/// color bar.
///
/// In a dense volumetric cloud, soft points would hide the stiff spots. Therefore
/// - the top and side view show the *stiffest* point along each line of sight (a maximum intensity
///   projection, as in medical imaging), at one common scale;
/// - the three-quarter view draws from far to near, and the size and opacity of a point grow with its
///   stiffness, so that soft material is a haze around the stiff parts.
///
/// All views are orthographic, so that lengths can be read off the axes. Gray never means stiffness. It
/// marks points that were not touched and, on request, the visible surface of the object.
///
/// ```
/// use nalgebra::Point3;
/// use vsf_plot::FieldView;
///
/// // A slab with a stiff bar inside.
/// let mut points_W: Vec<Point3<f64>> = Vec::new();
/// let mut stiffness = Vec::new();
/// for i in 0..30 {
///     for j in 0..20 {
///         points_W.push(Point3::new(0.01 * f64::from(i), 0.01 * f64::from(j), 0.0));
///         stiffness.push(if (8..12).contains(&j) { 250.0 } else { 20.0 });
///     }
/// }
/// let view = FieldView {
///     points_W: &points_W,
///     stiffness: &stiffness,
///     title: "Slab with a bar",
///     ..FieldView::default()
/// };
/// let png: Vec<u8> = view.png()?;
/// assert_eq!(&png[1..4], b"PNG");
/// let svg: String = view.svg()?;
/// assert!(svg.starts_with("<svg"));
/// # Ok::<(), vsf_plot::PlotError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct FieldView<'a> {
    /// Rest positions in the world frame, z up \[m\], each within ±1e6 m. At least one.
    pub points_W: &'a [Point3<f64>],
    /// One value per point \[N/m\], 0 ..= 1e15: the estimated stiffness, or its standard deviation
    /// together with a matching [`quantity`](Self::quantity).
    pub stiffness: &'a [f64],
    /// One flag per point, or empty if all points were touched. A point with `false` was not touched: its
    /// value means nothing, so it is drawn in gray and does not influence the colors.
    pub touched: &'a [bool],
    /// Points without a value that help to recognize the object, such as the surface seen by a camera
    /// \[m\]. Drawn faintly, behind the field. May be empty.
    pub context_W: &'a [Point3<f64>],
    /// One sRGB color per context point, or empty for gray.
    pub context_colors: &'a [Rgb],
    /// Outline of the robot: polylines in the world frame \[m\], such as the origins of the link frames
    /// from base to tool. The picture is framed to the points only; the robot is cut off at the panel's
    /// edge.
    pub robot_W: &'a [Vec<Point3<f64>>],
    /// First line of the picture. May be empty. In a PNG, characters outside Latin-1 are shown as `?`.
    pub title: &'a str,
    /// Name of the quantity, without its unit. It is the caption of the color bar and names the largest
    /// value in the legend. Default "stiffness".
    pub quantity: &'a str,
    /// Upper end of the color bar. Default: the 99 % quantile.
    pub limit: ColorLimit,
    /// Azimuth of the viewpoint of the three-quarter view: degrees from +x about +z. Default -60. The side
    /// view is seen along the horizontal axis nearest to it.
    pub azimuth_deg: f64,
    /// Elevation of that viewpoint, 5 ..= 85 degrees above the horizon. Default 25.
    pub elevation_deg: f64,
}

impl Default for FieldView<'_> {
    fn default() -> Self {
        Self {
            points_W: &[],
            stiffness: &[],
            touched: &[],
            context_W: &[],
            context_colors: &[],
            robot_W: &[],
            title: "",
            quantity: "stiffness",
            limit: ColorLimit::default(),
            azimuth_deg: -60.0,
            elevation_deg: 25.0,
        }
    }
}

impl FieldView<'_> {
    /// Width of the picture \[px\].
    pub const WIDTH: u32 = 1600;
    /// Height of the picture \[px\].
    pub const HEIGHT: u32 = 960;
    /// Largest number of colored points in an SVG. Of more, the stiffest are drawn, and the second line of
    /// the picture says so.
    pub const SVG_POINTS: usize = 12_000;
    /// Largest number of gray or context points in an SVG. Of more, an even selection is drawn.
    pub const SVG_CONTEXT: usize = 3_000;

    /// Renders the picture as a PNG file, 1600 x 960 pixels. Equal input gives equal bytes.
    ///
    /// # Errors
    /// [`PlotError::Empty`] without points, [`PlotError::Length`], [`PlotError::NotFinite`] or
    /// [`PlotError::OutOfRange`] for data outside the ranges stated at the fields,
    /// [`PlotError::Parameter`] for an option outside its range, [`PlotError::Encode`].
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        self.check()?;
        let scene = Scene::new(self, usize::MAX, usize::MAX)?;
        let mut canvas = Raster::new(Self::WIDTH, Self::HEIGHT);
        layout::draw(&scene, &mut canvas);
        canvas.into_png()
    }

    /// Renders the picture as an SVG file. Equal input gives equal bytes. The points take less than 5 MB;
    /// the robot is drawn in full.
    ///
    /// # Errors
    /// As [`png`](Self::png).
    pub fn svg(&self) -> Result<String, PlotError> {
        self.check()?;
        let scene = Scene::new(self, Self::SVG_POINTS, Self::SVG_CONTEXT)?;
        svg_file(Self::WIDTH, Self::HEIGHT, |backend| {
            let mut canvas = Vector::new(backend);
            layout::draw(&scene, &mut canvas);
            canvas.finish()
        })
    }

    fn check(&self) -> Result<(), PlotError> {
        let count = self.points_W.len();
        if count == 0 {
            return Err(PlotError::Empty {
                what: "points_W".into(),
            });
        }
        check_points("points_W", self.points_W)?;
        check_len("stiffness", self.stiffness.len(), count)?;
        check_values("stiffness", self.stiffness.iter().copied(), 0.0, STIFF)?;
        if !self.touched.is_empty() {
            check_len("touched", self.touched.len(), count)?;
        }
        check_points("context_W", self.context_W)?;
        if !self.context_colors.is_empty() {
            check_len(
                "context_colors",
                self.context_colors.len(),
                self.context_W.len(),
            )?;
        }
        for (i, line) in self.robot_W.iter().enumerate() {
            check_points(&format!("robot_W[{i}]"), line)?;
        }
        if !self.azimuth_deg.is_finite() {
            return Err(PlotError::Parameter {
                name: "azimuth_deg",
                value: self.azimuth_deg,
                range: "finite",
            });
        }
        if !(5.0..=85.0).contains(&self.elevation_deg) {
            return Err(PlotError::Parameter {
                name: "elevation_deg",
                value: self.elevation_deg,
                range: "5 ..= 85",
            });
        }
        Ok(())
    }
}

/// The index an error names counts points, not coordinates.
fn check_points(what: &str, points_W: &[Point3<f64>]) -> Result<(), PlotError> {
    let worst = points_W.iter().map(|p| {
        let [x, y, z] = p.coords.into();
        [x, y, z]
            .into_iter()
            .find(|v| !(-FAR..=FAR).contains(v))
            .unwrap_or(x)
    });
    check_values(what, worst, -FAR, FAR)
}
