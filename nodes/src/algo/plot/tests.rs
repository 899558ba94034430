use super::super::paint::hex;
use super::*;

fn plot(values: &[f64]) -> Plot {
    let x = (0..values.len()).map(|i| i as f64).collect();
    let series = Series { name: String::new(), x, y: values.to_vec(), colour: hex(0xFF0000) };
    Plot {
        title: String::new(),
        x_label: String::new(),
        span: [0.0, (values.len().max(2) - 1) as f64],
        x_step: 1.0,
        panels: vec![Panel { label: String::new(), series: vec![series], range: Some([0.0, 1.0]) }],
        bands: Vec::new(),
        legend: false,
        text: 8.0,
        width: 2.0,
        dots: 0.0,
    }
}

const SIZE: (usize, usize) = (320, 200);

fn drawn(plot: &Plot) -> (Vec<f32>, Area) {
    let mut data = vec![0.0; SIZE.0 * SIZE.1 * 4];
    let area = draw(plot, &mut data, SIZE.0, SIZE.1).unwrap();
    (data, area)
}

/// How much of each row is red, in pixels.
fn red(data: &[f32], row: usize) -> f64 {
    let pixels = data[row * SIZE.0 * 4..(row + 1) * SIZE.0 * 4].chunks_exact(4);
    pixels.map(|p| f64::from((p[0] - p[1]).max(0.0))).sum()
}

#[test]
fn plot_line_lies_at_its_value_and_covers_its_width() {
    let (data, area) = drawn(&plot(&[0.5; 9]));
    let total: f64 = (0..SIZE.1).map(|y| red(&data, y)).sum();
    // Where the line passes over the grid there is a little less red to add; within that, it is length times width and two half discs.
    let truth = (area[2] - area[0]) * 2.0 + std::f64::consts::PI;
    assert!((total / truth - 1.0).abs() < 0.02, "expected {truth}, found {total}");
    let centre = (0..SIZE.1).map(|y| red(&data, y) * (y as f64 + 0.5)).sum::<f64>() / total;
    assert!((centre - (area[1] + area[3]) / 2.0).abs() < 0.1, "found {centre} in {area:?}");
}

#[test]
fn plot_breaks_a_line_where_a_value_is_not_finite() {
    let whole: f64 = (0..SIZE.1).map(|y| red(&drawn(&plot(&[0.5; 9])).0, y)).sum();
    let (data, area) = drawn(&plot(&[0.5, 0.5, 0.5, f64::NAN, f64::INFINITY, 0.5, 0.5, 0.5, 0.5]));
    let broken: f64 = (0..SIZE.1).map(|y| red(&data, y)).sum();
    let missing = (area[2] - area[0]) * 3.0 / 8.0 * 2.0;
    assert!((whole - broken - missing).abs() < 8.0, "expected {missing} less, found {}", whole - broken);
}

#[test]
fn plot_line_stays_within_a_range_that_was_asked_for() {
    let (data, area) = drawn(&plot(&[0.5, 9.0, -1e250, 0.5]));
    for y in (0..area[1] as usize).chain(area[3] as usize + 2..SIZE.1) {
        assert!(red(&data, y) < 1e-6, "row {y}");
    }
    assert!(red(&data, area[1] as usize + 2) > 1.0);
}

#[test]
fn plot_fits_its_axis_to_what_is_finite() {
    assert_eq!(fitted([0.0, 10.0, f64::NAN, f64::INFINITY].into_iter()), [-0.5, 10.5]);
    assert_eq!(fitted(std::iter::empty()), [-1.0, 1.0]);
    assert_eq!(fitted([0.0, 0.0].into_iter()), [-1.0, 1.0]);
    assert_eq!(fitted([2.0, 2.0 + 1e-12].into_iter()).map(|v| (v * 1e6).round() / 1e6), [1.8, 2.2]);
    assert!(fitted([f64::MAX, f64::MIN].into_iter()) == [-1.0, 1.0]);
}

#[test]
fn plot_that_is_too_small_says_how_large_it_must_be() {
    let error = draw(&plot(&[1.0]), &mut [0.0; 4 * 30 * 20], 30, 20).unwrap_err();
    let PlotError::TooSmall { least_width, least_height, .. } = error else { panic!("{error}") };
    let mut data = vec![0.0; 4 * least_width * least_height];
    assert!(draw(&plot(&[1.0]), &mut data, least_width, least_height).is_ok());
    assert!(matches!(draw(&plot(&[1.0]), &mut [0.0; 4], 300, 200), Err(PlotError::Canvas(_))));
}

#[test]
fn plot_is_opaque_and_its_ground_is_white() {
    let mut empty = plot(&[]);
    empty.bands = vec![[-5.0, 0.5]];
    let (data, area) = drawn(&empty);
    assert!(data.chunks_exact(4).all(|p| p[3] == 1.0));
    assert_eq!(data[..4], [1.0; 4]);
    let band = |x: f64| data[((area[1] as usize + 3) * SIZE.0 + x as usize) * 4];
    assert!(band(area[0] + 5.0) < 1.0 && band(area[2] - 5.0) == 1.0);
}

#[test]
fn plot_names_no_line_twice() {
    let mut plot = plot(&[0.5; 3]);
    plot.legend = true;
    plot.panels[0].series[0].name = "residual".into();
    let named = drawn(&plot).1;
    plot.panels[0].label = "residual".into();
    assert!(drawn(&plot).1[2] > named[2] + 20.0, "the room of the legend is the panel's");
}
