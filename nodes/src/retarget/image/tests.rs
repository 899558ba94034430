use super::*;
use crate::counted::clock;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::Cancel;
use std::f64::consts::PI;

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
        align: AlignTo::None,
        align_model: Model::Affine,
        falloff: 2.0,
        volume: 0.0,
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
fn pictures_that_do_not_go_with_the_keys_are_refused() {
    let message = |node| run(node).err().unwrap().message;
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

/// A picture with a stroke of two by twenty pixels, and its line of action, upright and bent by half a turn.
fn stroke() -> RetargetImage {
    let mut samples = vec![0.0; 40 * 30 * 4];
    (5..25).for_each(|y| samples[(y * 40 + 19) * 4..][..8].fill(1.0));
    let upright = (0..=20).map(|i| [20.0, 5.0 + f64::from(i)]);
    let bent = (0..=20).map(|i| libm::sincos(f64::from(i) * PI / 20.0)).map(|(s, c)| [20.0 - 20.0 / PI * (1.0 - c), 10.0 + 20.0 / PI * s]);
    let mut made = node(vec![Image::new(40, 30, 4, samples).unwrap()], &[0.0, 1.0]);
    let points = upright.chain(bent).flatten().collect();
    made.keys = In::new(KeyShapes { points: NdArray::new([2, 21, 2], points).unwrap(), names: Vec::new(), closed: false });
    made
}

#[test]
fn an_open_curve_bends_the_picture_around_it() {
    let image = run(stroke()).unwrap();
    // On the arc there is paint, and inside of it there is none.
    for i in 1..8 {
        let (s, c) = libm::sincos(f64::from(i) * PI / 8.0);
        let at = [20.0 - 20.0 / PI * (1.0 - c), 10.0 + 20.0 / PI * s];
        assert!(pixel(&image, at[0] as i64, at[1] as i64)[3] > 0.4, "{i}: {:?}", pixel(&image, at[0] as i64, at[1] as i64));
    }
    assert!(pixel(&image, 14, 11)[3] < 1e-6 && pixel(&image, 13, 13)[3] < 1e-6);
    let paint: f32 = image.samples().iter().skip(3).step_by(4).sum();
    assert!((paint - 40.0).abs() < 3.0, "{paint}");
    let mut still = stroke();
    still.weights = In::new(Weights { weights: vec![1.0, 0.0] });
    let image = run(still).unwrap();
    assert!((5..25).all(|y| pixel(&image, 19, y) == [1.0; 4] && pixel(&image, 18, y)[3] < 1e-4), "{:?}", pixel(&image, 18, 12));
}

/// The motion does to what is around an open curve what it does to the curve: twice as large is twice as wide, and a mirror mirrors.
#[test]
fn the_motion_scales_and_mirrors_what_an_open_curve_carries() {
    let mut large = stroke();
    // A dab of two by two pixels to the left of the stroke.
    let mut samples = large.image.0[0].samples().to_vec();
    for y in [14, 15] {
        samples[(y * 40 + 14) * 4..][..8].fill(1.0);
    }
    large.image = List(vec![In::new(Image::new(40, 30, 4, samples).unwrap())]);
    large.weights = In::new(Weights { weights: vec![1.0, 0.0] });
    large.motion = Some(In::new(Affine2 { matrix: [[-2.0, 0.0, 80.0], [0.0, 2.0, 0.0]] }));
    (large.volume, large.expand) = (1.0, true);
    let image = run(large).unwrap();
    let paint: f32 = image.samples().iter().skip(3).step_by(4).sum();
    assert!((paint - 176.0).abs() < 5.0, "{paint}");
    // The stroke goes from 19..21 to 38..42, the dab from 14..16 to 48..52.
    assert!((38..42).all(|x| pixel(&image, x, 20)[3] > 0.7), "{:?}", [38, 41].map(|x| pixel(&image, x, 20)[3]));
    assert!(pixel(&image, 49, 29)[3] > 0.7 && pixel(&image, 35, 29)[3] < 0.1, "{:?}", [35, 49].map(|x| pixel(&image, x, 29)[3]));
}

/// Aligned keys are blended in one place, and each picture is still read where it was drawn.
#[test]
fn pictures_are_read_where_they_were_drawn() {
    let shifted = vec![2.0, 2.0, 6.0, 2.0, 6.0, 6.0, 2.0, 6.0, 5.0, 4.0, 9.0, 4.0, 9.0, 8.0, 5.0, 8.0];
    let spot = |x: usize, y: usize| {
        let mut samples = vec![0.0; 576];
        samples[(y * 12 + x) * 4..][..4].fill(1.0);
        Image::new(12, 12, 4, samples).unwrap()
    };
    let mut node = node(vec![spot(4, 3), spot(7, 5)], &[0.5, 0.5]);
    node.keys = In::new(KeyShapes { points: NdArray::new([2, 4, 2], shifted).unwrap(), names: Vec::new(), closed: true });
    node.align = AlignTo::First;
    let image = run(node).unwrap();
    assert!(pixel(&image, 4, 3).iter().all(|v| (v - 1.0).abs() < 1e-5), "{:?}", pixel(&image, 4, 3));
}
