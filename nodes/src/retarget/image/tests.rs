use super::*;
use crate::counted::clock;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::Cancel;

fn keys(closed: bool) -> KeyShapes {
    let points = vec![2.0, 2.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 10.0, 2.0, 10.0, 2.0, 2.0];
    KeyShapes { points: NdArray::new([2, 4, 2], points).unwrap(), names: Vec::new(), closed }
}

/// A picture of 12 by 12 of one colour, with an alpha of 1 where there are four channels.
fn flat(channels: usize, value: f32) -> Image {
    let pixel: Vec<f32> = [value, value, value, 1.0][..channels].to_vec();
    Image::new(12, 12, channels, pixel.repeat(144)).unwrap()
}

fn node(images: Vec<Image>, weights: &[f64]) -> RetargetImage {
    RetargetImage {
        image: List(images.into_iter().map(In::new).collect()),
        keys: In::new(keys(true)),
        weights: In::new(Weights { weights: weights.to_vec() }),
        motion: None,
        place: None,
        interpolation: Interpolation::Arap,
        inbetweens: 3,
        symmetric: true,
        anchor: None,
        image_key: 0,
        edge: Edge::Auto,
        margin: 1.0,
        filter: Filter::Cubic,
        size: None,
        expand: false,
    }
}

fn run(node: RetargetImage) -> Result<Image, NodeError> {
    let (clock, cancel) = (clock(1), Cancel::default());
    node.run(None, &Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel }).map(|(o, _)| o.image)
}

fn pixel(image: &Image, x: i64, y: i64) -> Vec<f32> {
    let (own, c) = (image.data_window(), image.n_channels());
    let at = ((y - own.y) as usize * own.width + (x - own.x) as usize) * c;
    image.samples()[at..at + c].to_vec()
}

/// Without an alpha the contour is the matte: exact shares of the pixels along it.
#[test]
fn a_photograph_is_cut_out_at_the_contour() {
    let mut half = node(vec![flat(3, 0.5)], &[1.0, 0.0]);
    half.motion = Some(In::new(Affine2 { matrix: [[1.0, 0.0, 0.25], [0.0, 1.0, 0.0]] }));
    let image = run(half).unwrap();
    assert_eq!(image.alpha(), Some(3));
    let near = |found: Vec<f32>, truth: f32| found.iter().zip([0.5, 0.5, 0.5, 1.0]).all(|(f, t)| (f - t * truth).abs() < 1e-5);
    assert!(
        near(pixel(&image, 6, 6), 1.0) && near(pixel(&image, 2, 6), 0.75) && near(pixel(&image, 10, 6), 0.25),
        "{:?}",
        pixel(&image, 2, 6)
    );
}

#[test]
fn pictures_for_each_key_are_dissolved() {
    let image = run(node(vec![flat(4, 0.2), flat(4, 0.8)], &[0.25, 0.75])).unwrap();
    assert!(pixel(&image, 6, 6).iter().zip([0.65, 0.65, 0.65, 1.0]).all(|(a, b)| (a - b).abs() < 1e-5));
    // Weights below 0 exaggerate the shape; the picture is the other's.
    let image = run(node(vec![flat(4, 0.2), flat(4, 0.8)], &[-0.25, 1.25])).unwrap();
    assert!(pixel(&image, 6, 6).iter().zip([0.8, 0.8, 0.8, 1.0]).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn one_picture_may_belong_to_any_key() {
    let mut node = node(vec![flat(4, 0.5)], &[0.5, 0.5]);
    node.image_key = 1;
    let image = run(node).unwrap();
    // The square stands on its corner.
    assert!((pixel(&image, 6, 1)[3] - 1.0).abs() < 1e-6 && (pixel(&image, 6, 6)[0] - 0.5).abs() < 1e-6);
}

#[test]
fn what_has_no_inside_or_no_picture_is_refused() {
    let message = |node| run(node).err().unwrap().message;
    let mut open = node(vec![flat(4, 0.5)], &[1.0, 0.0]);
    open.keys = In::new(keys(false));
    assert_eq!(message(open), "expected closed key shapes, which have an inside, found open ones");
    assert_eq!(
        message(node(Vec::new(), &[1.0, 0.0])),
        "expected one picture, or 2 with 2 weights, one for each key, found 0 with 2 weights"
    );
    let mut far = node(vec![flat(4, 0.5)], &[1.0, 0.0]);
    far.image_key = 2;
    assert_eq!(message(far), "expected an image_key below 2, the number of keys, found 2");
}

/// A motion to beyond the picture leaves an empty one, not a failure.
#[test]
fn a_shape_off_the_format_is_nowhere() {
    let mut node = node(vec![flat(4, 0.5)], &[1.0, 0.0]);
    node.motion = Some(In::new(Affine2 { matrix: [[1.0, 0.0, 500.0], [0.0, 1.0, 0.0]] }));
    assert!(run(node).unwrap().samples().is_empty());
}
