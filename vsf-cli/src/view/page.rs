use super::{Cloud, Motion};
use crate::console::harmless;
use crate::html::{Script, document, escape};
use serde::Serialize;
use vsf::plot::stiffness_color;

const STYLE: &str = concat!(
    include_str!("../diagnosis/page.css"),
    include_str!("view.css")
);
const BODY: &str = include_str!("view.html");
const SCRIPT: &str = include_str!("view.js");
/// Colors of the bar.
const COLORS: u32 = 64;

/// What a page shows.
#[derive(Serialize)]
pub struct View<'a> {
    #[serde(skip)]
    pub title: &'a str,
    pub cloud: &'a Cloud,
    pub motion: Option<&'a Motion>,
}

/// All that the script reads.
#[derive(Serialize)]
struct Data<'a> {
    #[serde(flatten)]
    view: &'a View<'a>,
    origin: [f64; 3],
    palette: Vec<[u8; 3]>,
}

/// The page: it needs nothing else, no network and no graphics card.
pub fn page(view: &View) -> anyhow::Result<String> {
    let color = |k| stiffness_color(f64::from(k) / f64::from(COLORS - 1));
    let data = Data {
        view,
        origin: view.cloud.origin_W.coords.into(),
        palette: (0..COLORS).map(color).collect(),
    };
    // Within a script element no text of the data may close it or open a comment.
    let data = harmless(&serde_json::to_string(&data)?).replace('<', "\\u003c");
    let notes = [view.cloud.note(), view.motion.and_then(Motion::note)];
    let notes: String = (notes.iter().flatten())
        .map(|note| format!("<p class=\"small\">{}</p>\n", escape(note)))
        .collect();
    let body = format!(
        "<h1>{}</h1>\n{BODY}{notes}<script type=\"application/json\" id=\"data\">{data}</script>\n\
         <script>\n{SCRIPT}</script>\n",
        escape(view.title)
    );
    Ok(document(view.title, STYLE, Script::Own, &body))
}
