//! How a value of each type is shown.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use pegbar_engine::array::describe_shape;
use pegbar_engine::value::{AnyValue, TimeMap, Value, ValueRef, downcast};
use pegbar_nodes::algo::codec::{DecodeOptions, decode};
use pegbar_nodes::algo::raster::Raster;
use pegbar_nodes::data::{
    Basis, Correspondences, Curves, Drawing, Image, KeyDrawings, KeyImages, KeyShapes, Markers2, Markers3, Matte, Mesh, Pose, Shape,
    Skeleton, SkinnedMesh, Table, WarpPath,
};

use super::html::{escape, number};
use super::picture::Thumb;
use super::plot;
use super::sketch::{Sketch, surface};

/// Pixels of a picture of one frame among several, and of one that stands for all.
const SMALL: [usize; 2] = [340, 300];
const LARGE: [usize; 2] = [1000, 760];
/// Rows and columns of a table at most.
const ROWS: usize = 60;
const COLUMNS: usize = 16;
/// Keys of a set that are shown.
const KEYS: usize = 6;

/// What is shown of a value.
pub(super) enum Shown {
    /// It is about to be.
    Nothing,
    /// Elements of a page.
    Html(String),
    /// To be framed with the other frames'.
    Sketches(Vec<Sketch>),
    /// To be drawn on its skeleton.
    Pose(Arc<Pose>),
    /// For poses.
    Skeleton(Arc<Skeleton>),
}

fn of<T: Value>(value: &ValueRef) -> Option<Arc<T>> {
    downcast(value.clone())
}

/// True for a type that [`thumb`] makes a picture of.
pub(crate) fn is_picture(ty: &str) -> bool {
    [Image::NAME, Matte::NAME, Mesh::NAME, SkinnedMesh::NAME].contains(&ty)
}

/// A value as a picture of at most so many pixels; `None` where it is none.
pub(crate) fn thumb(value: &ValueRef, most: [usize; 2]) -> Option<Thumb> {
    match value.type_name() {
        Image::NAME => {
            let image: Arc<Image> = of(value)?;
            let image = image.in_display().ok()?;
            Thumb::of(image.raster(), image.alpha(), most)
        }
        Matte::NAME => {
            let matte: Arc<Matte> = of(value)?;
            Thumb::of(Raster::new(matte.alpha(), matte.width(), matte.height(), 1)?, None, most)
        }
        Mesh::NAME => surface(of::<Mesh>(value)?.as_ref()),
        SkinnedMesh::NAME => surface(&of::<SkinnedMesh>(value)?.rest()),
        _ => None,
    }
}

/// The picture in a file.
pub(crate) fn thumb_of_file(file: &Path, most: [usize; 2]) -> Option<Thumb> {
    let picture = decode(&std::fs::read(file).ok()?, &DecodeOptions { threads: 1, ..DecodeOptions::default() }).ok()?;
    let alpha = picture.channels.iter().position(|name| name == "A");
    Thumb::of(Raster::new(&picture.pixels, picture.width, picture.height, picture.channels.len())?, alpha, most)
}

/// What is shown of `value`, which `is_alone` where there is one for all frames.
pub(super) fn show(value: &ValueRef, is_alone: bool) -> Shown {
    let most = if is_alone { LARGE } else { SMALL };
    let sketch = |sketch: Option<Sketch>| sketch.map(|s| Shown::Sketches(vec![s]));
    let shown = match value.type_name() {
        ty if is_picture(ty) => thumb(value, most).and_then(img),
        KeyImages::NAME => of(value).map(|keys: Arc<KeyImages>| key_images(&keys)),
        Shape::NAME => sketch(of(value).map(|shape: Arc<Shape>| Sketch::shape(&shape))),
        KeyShapes::NAME => sketch(of(value).map(|keys: Arc<KeyShapes>| Sketch::key_shapes(&keys))),
        Curves::NAME => sketch(of(value).map(|curves: Arc<Curves>| Sketch::curves(&curves))),
        Markers2::NAME => sketch(of(value).map(|markers: Arc<Markers2>| Sketch::points(&markers.points))),
        Markers3::NAME => sketch(of(value).map(|markers: Arc<Markers3>| Sketch::points_3d(&markers.points))),
        Correspondences::NAME => sketch(of(value).map(|pairs: Arc<Correspondences>| Sketch::points(&pairs.points))),
        Drawing::NAME => sketch(of(value).map(|drawing: Arc<Drawing>| Sketch::drawing(&drawing))),
        KeyDrawings::NAME => of(value).map(|keys: Arc<KeyDrawings>| Shown::Sketches(Sketch::key_drawings(&keys))),
        Pose::NAME => of(value).map(Shown::Pose),
        Skeleton::NAME => of(value).map(Shown::Skeleton),
        Table::NAME => of(value).map(|of: Arc<Table>| Shown::Html(table(&of))),
        WarpPath::NAME => of(value).map(|path: Arc<WarpPath>| Shown::Html(warp_path(&path))),
        TimeMap::NAME => of(value).map(|map: Arc<TimeMap>| Shown::Html(time_map(&map))),
        Basis::NAME => of(value).map(|of: Arc<Basis>| Shown::Html(basis(&of))),
        _ => None,
    };
    shown.unwrap_or_else(|| Shown::Html(format!("<p class=\"plain\">{}</p>", escape(&described(value.as_ref())))))
}

fn img(thumb: Thumb) -> Option<Shown> {
    let (width, height) = (thumb.width, thumb.height);
    Some(Shown::Html(format!("<img src=\"{}\" width=\"{width}\" height=\"{height}\" alt=\"\">", thumb.uri()?)))
}

fn key_images(keys: &KeyImages) -> Shown {
    let [k, h, w, c] = keys.pixels.shape();
    let alpha = [None, None, Some(1), None, Some(3)].get(c).copied().flatten();
    let one = |samples: &[f32]| Thumb::of(Raster::new(samples, w, h, c)?, alpha, [200, 200]).and_then(img);
    let shown = keys.pixels.data().chunks((h * w * c).max(1)).take(KEYS).filter_map(one);
    let pictures: String = shown.map(|shown| if let Shown::Html(html) = shown { html } else { String::new() }).collect();
    Shown::Html(format!("{pictures}{}", more(k, KEYS, "key")))
}

/// `and 3 more keys`, or nothing.
fn more(n: usize, most: usize, what: &str) -> String {
    if n > most { format!("<p class=\"plain\">and {} more</p>", crate::console::count(n - most, what)) } else { String::new() }
}

/// Numbers with the names of their rows and columns.
pub(super) fn table(table: &Table) -> String {
    let [n, k] = table.values.shape();
    let mut out = String::from("<div class=\"wide\"><table class=\"numbers\"><thead><tr><th></th>");
    let name = |names: &[String], i: usize| names.get(i).cloned().unwrap_or_else(|| (i + 1).to_string());
    out.extend((0..k.min(COLUMNS)).map(|c| format!("<th>{}</th>", escape(&name(&table.columns, c)))));
    out.push_str("</tr></thead><tbody>");
    for (row, values) in table.values.data().chunks(k.max(1)).enumerate().take(ROWS.min(n)) {
        let _ = write!(out, "<tr><th>{}</th>", escape(&name(&table.rows, row)));
        out.extend(values.iter().take(COLUMNS).map(|v| format!("<td>{}</td>", number(*v))));
        out.push_str("</tr>");
    }
    out + "</tbody></table></div>" + &more(n, ROWS, "row") + &more(k, COLUMNS, "column")
}

fn warp_path(path: &WarpPath) -> String {
    let pairs: Vec<[f64; 2]> = path.pairs.data().chunks_exact(2).map(|p| [p[0] as f64, p[1] as f64]).collect();
    plot::path(&pairs, "target frame", "source frame")
}

fn time_map(map: &TimeMap) -> String {
    let places: Vec<f64> = (1..=map.source_frames.len()).map(|i| i as f64).collect();
    let lines = vec![("source frame".to_owned(), map.source_frames.clone())];
    plot::plot(&[plot::Panel { label: "source frame".to_owned(), lines }], &places, "th frame")
}

fn basis(basis: &Basis) -> String {
    let total: f64 = basis.variances.iter().sum();
    let shares = basis.variances.iter().take(8).map(|v| format!("{} %", number((v / total * 1e3).round() / 10.0)));
    let shares: Vec<String> = shares.collect();
    let more = if basis.variances.len() > 8 { ", …" } else { "" };
    let [l, d] = basis.components.shape();
    format!("<p class=\"plain\">{l} components of {d} numbers; of the variance {}{more}</p>", shares.join(", "))
}

/// The arrays of a value and their extents.
fn described(value: &dyn AnyValue) -> String {
    let parts = value.parts();
    let arrays = parts.arrays.iter().map(|(name, array)| format!("{name} [{}]", describe_shape(&array.shape)));
    let texts = parts.meta.iter().map(|(name, text)| format!("{name} {}", super::html::shortened(&text.to_string(), 80)));
    arrays.chain(texts).collect::<Vec<_>>().join(", ")
}
