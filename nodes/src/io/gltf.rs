//! What the glTF nodes share: names in settings, whose fault a failure is, textures in one picture.

use std::path::Path;

use pegbar_engine::node::{Fault, NodeError};
use pegbar_engine::setting::{Setting, SettingError};

use crate::algo::gltf::{GltfError, Part, Pick};
use crate::data::Image;

/// Names or numbers of some of a file's parts: `"Body"`, `2`, `["Body", "Head"]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picks(pub(super) Vec<Pick>);

impl Setting for Picks {
    fn type_name() -> String {
        "name, number, or list of them".to_owned()
    }

    fn parse(text: &str) -> Result<Self, SettingError> {
        let one = |text: &str| match (String::parse(text), usize::parse(text)) {
            (Ok(name), _) => Ok(Pick::Name(name)),
            (_, Ok(index)) => Ok(Pick::Index(index)),
            _ => Err(SettingError::whole(
                text,
                format!("expected a name in quotes, a number from 0, or a list of names, found {}", text.trim()),
            )),
        };
        if !text.trim_start().starts_with('[') {
            return one(text).map(|pick| Self(vec![pick]));
        }
        match (Vec::<String>::parse(text), Vec::<i64>::parse(text)) {
            (Ok(names), _) => Ok(Self(names.into_iter().map(Pick::Name).collect())),
            (_, Ok(numbers)) if numbers.iter().all(|n| *n >= 0) => Ok(Self(numbers.into_iter().map(|n| Pick::Index(n as usize)).collect())),
            (Err(error), _) => Err(error),
        }
    }
}

/// A failure at a file.
pub(super) fn refused(path: &Path, error: &GltfError) -> NodeError {
    let fault = match error {
        GltfError::Malformed { .. } => Fault::Input,
        GltfError::Unsupported { .. } => Fault::Unsupported,
        GltfError::TooLarge { .. } => Fault::Limit,
        GltfError::NoSuch(_) => Fault::Parameters,
        GltfError::File(_) => Fault::Io,
    };
    NodeError::new(fault, format!("{}: {error}", path.display()))
}

/// White, which leaves colours as they are: what stands for a texture that there is not.
pub(super) fn white() -> Result<Image, NodeError> {
    Image::new(1, 1, 4, vec![1.0; 4]).ok_or_else(|| NodeError::internal("a picture of another size"))
}

/// Red, green, blue and alpha of each pixel.
fn rgba(image: &Image) -> Vec<[f32; 4]> {
    let wide = |p: &[f32]| match *p {
        [y] => [y, y, y, 1.0],
        [y, a] => [y, y, y, a],
        [r, g, b] => [r, g, b, 1.0],
        [r, g, b, a, ..] => [r, g, b, a],
        [] => [0.0; 4],
    };
    image.samples().chunks_exact(image.n_channels().max(1)).map(wide).collect()
}

/// One picture for parts with textures of their own: below each other, each with a margin of its edge. Texture coordinates are changed to fit. `None`
/// for an image stands for white. What is repeated is laid side by side as often as a part asks for.
///
/// # Errors
/// Where a part repeats its texture more often than [`REPEATS`] says.
pub(super) fn atlas(parts: &[Part], pages: &[(Option<usize>, Option<Image>)], uvs: &mut [[f64; 2]]) -> Result<Image, NodeError> {
    let size = |i: &Option<Image>| i.as_ref().map_or((1, 1), |i| (i.width(), i.height()));
    let tiles = pages.iter().map(|(i, page)| repeated(parts, *i, uvs, size(page))).collect::<Result<Vec<_>, _>>()?;
    let sizes: Vec<(usize, usize)> = pages.iter().zip(&tiles).map(|((_, i), (_, n))| (size(i).0 * n[0], size(i).1 * n[1])).collect();
    let (width, height) = (sizes.iter().map(|s| s.0).max().unwrap_or(0) + 2, sizes.iter().map(|s| s.1 + 2).sum::<usize>());
    let mut samples = vec![0.0; width * height * 4];
    let mut top = 0;
    for (((image, page), (w, h)), (first, _)) in pages.iter().zip(sizes).zip(tiles) {
        let pixels = page.as_ref().map_or_else(|| vec![[1.0; 4]], rgba);
        let (columns, rows) = size(page);
        for y in 0..h + 2 {
            for x in 0..width {
                let from = y.saturating_sub(1).min(h - 1) % rows * columns + x.saturating_sub(1).min(w - 1) % columns;
                let to = ((top + y) * width + x) * 4;
                samples[to..to + 4].copy_from_slice(&pixels[from]);
            }
        }
        for uv in parts.iter().filter(|p| p.image == *image).flat_map(|p| p.vertices.clone()) {
            let [u, v] = if image.is_some() { [0, 1].map(|k| uvs[uv][k] - first[k]) } else { [0.5; 2] };
            uvs[uv] = [(1.0 + u * columns as f64) / width as f64, ((top + 1) as f64 + v * rows as f64) / height as f64];
        }
        top += h + 2;
    }
    Image::new(width, height, 4, samples).ok_or_else(|| NodeError::internal("a picture of another size"))
}

/// Repeats of a texture, along and down together, that lie beside others at most.
const REPEATS: f64 = 256.0;
/// Pixels of a repeated texture at most: a gigabyte.
const PIXELS: f64 = 67_108_864.0;

/// The whole texture coordinates at which the repeats begin that the parts of an image ask for, and how many there are along and down.
fn repeated(parts: &[Part], image: Option<usize>, uvs: &[[f64; 2]], size: (usize, usize)) -> Result<([f64; 2], [usize; 2]), NodeError> {
    let own = parts.iter().filter(|p| p.image == image && image.is_some()).flat_map(|p| p.vertices.clone());
    let (mut low, mut high) = ([0.0_f64; 2], [1.0_f64; 2]);
    for uv in own {
        // An edge of the texture is not yet its next repeat, within what is rounded.
        for k in 0..2 {
            low[k] = low[k].min((uvs[uv][k] + 1e-3).floor());
            high[k] = high[k].max(if uvs[uv][k].is_nan() { f64::INFINITY } else { (uvs[uv][k] - 1e-3).ceil() });
        }
    }
    let n = [0, 1].map(|k| high[k] - low[k]);
    let all = n[0] * n[1];
    if all <= 1.0 || (all <= REPEATS && all * size.0 as f64 * size.1 as f64 <= PIXELS) {
        return Ok((low, n.map(|n| n as usize)));
    }
    let error = NodeError::new(
        Fault::Unsupported,
        format!(
            "expected at most {REPEATS} repeats and {PIXELS} pixels of a texture where parts have textures of their own, found {} x {}",
            n[0], n[1]
        ),
    );
    Err(error.help("read the parts of one texture by `material`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_picked_by_name_or_number() {
        let pick = |text: &str| Picks::parse(text).map(|p| p.0);
        assert_eq!(pick("\"Body\""), Ok(vec![Pick::Name("Body".to_owned())]));
        assert_eq!(pick(" 2"), Ok(vec![Pick::Index(2)]));
        assert_eq!(pick("[\"a\", \"b\"]").unwrap().len(), 2);
        assert_eq!(pick("[1, 0]"), Ok(vec![Pick::Index(1), Pick::Index(0)]));
        assert_eq!(pick("[]"), Ok(Vec::new()));
        assert!(pick("-1").is_err() && pick("[-1]").is_err() && pick("x").is_err());
    }

    #[test]
    fn textures_lie_below_each_other() {
        let red = Image::new(2, 1, 3, vec![1.0, 0.0, 0.0, 0.5, 0.0, 0.0]).unwrap();
        let parts = [Part { image: Some(7), vertices: 0..2 }, Part { image: None, vertices: 2..3 }];
        let mut uvs = vec![[0.25, 0.5], [0.75, 0.5], [9.0, 9.0]];
        let pages = [(Some(7), Some(red)), (None, None)];
        let image = atlas(&parts, &pages, &mut uvs).unwrap();
        let at = |image: &Image, [u, v]: [f64; 2]| {
            let (x, y) = ((u * image.width() as f64) as usize, (v * image.height() as f64) as usize);
            image.samples()[(y * image.width() + x) * 4]
        };
        assert_eq!(uvs.iter().map(|uv| at(&image, *uv)).collect::<Vec<_>>(), [1.0, 0.5, 1.0]);
        // From -1 to 2 along, once more than there is of it.
        let mut uvs = vec![[-0.75, 0.5], [1.75, 0.5], [9.0, 9.0]];
        let image = atlas(&parts, &pages, &mut uvs).unwrap();
        assert_eq!((image.width(), uvs.iter().map(|uv| at(&image, *uv)).collect::<Vec<_>>()), (8, vec![1.0, 0.5, 1.0]));
        let error = atlas(&parts, &pages, &mut [[270.5, 0.0], [0.0; 2], [0.0; 2]]).unwrap_err();
        assert!(error.message.starts_with("expected at most 256 repeats and"), "{}", error.message);
    }
}
