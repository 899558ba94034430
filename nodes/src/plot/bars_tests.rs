use super::*;
use crate::counted::{clock, counted};
use pegbar_engine::array::NdArray;
use pegbar_engine::node::Cancel;
use pegbar_engine::value::Vector;

fn table(rows: &[&str], columns: &[&str], values: &[f64]) -> AnySequence {
    let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect::<Vec<String>>();
    let shape = [values.len() / columns.len(), columns.len()];
    let table = Table { values: NdArray::new(shape, values.to_vec()).unwrap(), rows: names(rows), columns: names(columns) };
    counted(1, move |_| table.clone()).0
}

fn vectors(frames: &'static [[f64; 2]]) -> AnySequence {
    counted(frames.len(), |k| Vector { values: frames[k].to_vec() }).0
}

fn node(values: Vec<AnySequence>) -> PlotBars {
    PlotBars {
        values: List(values),
        labels: Vec::new(),
        names: Vec::new(),
        column: "rms".to_owned(),
        whisker: None,
        factor: 1.0,
        unit: "m".to_owned(),
        order: Order::Given,
        mean: true,
        numbers: true,
        title: String::new(),
        x_label: None,
        x_range: None,
        width: 400,
        height: None,
        colors: Vec::new(),
        text_size: 8.0,
    }
}

fn measures() -> AnySequence {
    table(&["hand", "foot"], &["rms", "mean", "max"], &[1.0, 0.5, 2.0, 3.0, 2.5, 4.0])
}

fn with<T>(work: impl FnOnce(&Context) -> T) -> T {
    let (clock, cancel) = (clock(4), Cancel::default());
    work(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })
}

fn plot(node: PlotBars) -> Result<BarPlot, String> {
    with(|cx| node.plot(cx)).map_err(|e| e.message)
}

#[test]
fn tables_are_bars_with_whiskers() {
    let found = plot(node(vec![measures()])).unwrap();
    assert_eq!((found.rows, found.x_label), (vec!["hand".to_owned(), "foot".to_owned()], "rms, m; whiskers to max".to_owned()));
    assert_eq!((found.series[0].lengths.clone(), found.series[0].whiskers.clone()), (vec![1.0, 3.0], vec![2.0, 4.0]));
    let other = plot(PlotBars {
        column: "mean".to_owned(),
        whisker: Some(String::new()),
        factor: 100.0,
        unit: "cm".to_owned(),
        ..node(vec![measures()])
    })
    .unwrap();
    assert_eq!((other.series[0].lengths.clone(), other.x_label), (vec![50.0, 250.0], "mean, cm".to_owned()));
    assert!(other.series[0].whiskers.iter().all(|w| w.is_nan()));
}

#[test]
fn series_go_together_by_name() {
    let other = table(&["tail", "foot"], &["rms"], &[7.0, 8.0]);
    let found = plot(node(vec![measures(), other])).unwrap();
    assert_eq!(found.rows, ["hand", "foot", "tail"]);
    assert!(found.series[1].lengths[0].is_nan() && found.series[1].lengths[1..] == [8.0, 7.0]);
    assert!(found.series[1].whiskers.iter().all(|w| w.is_nan()));
    let some = plot(PlotBars { names: vec!["foot".to_owned()], ..node(vec![measures()]) }).unwrap();
    assert_eq!((some.rows.len(), some.series[0].lengths[0]), (1, 3.0));
    let sorted = plot(PlotBars { order: Order::Largest, ..node(vec![measures()]) }).unwrap();
    assert_eq!(sorted.rows, ["foot", "hand"]);
}

#[test]
fn numbers_over_time_are_their_mean_and_their_most() {
    let found = plot(node(vec![vectors(&[[1.0, -4.0], [3.0, f64::NAN]])])).unwrap();
    assert_eq!((found.rows, found.x_label), (vec!["[0]".to_owned(), "[1]".to_owned()], "value, m; whiskers to max".to_owned()));
    assert_eq!((found.series[0].lengths.clone(), found.series[0].whiskers.clone()), (vec![2.0, -4.0], vec![3.0, -4.0]));
    let one = plot(PlotBars { names: vec!["a".to_owned(), "b".to_owned()], ..node(vec![vectors(&[[1.0, 2.0]])]) }).unwrap();
    assert_eq!((one.rows, one.series[0].lengths.clone()), (vec!["a".to_owned(), "b".to_owned()], vec![1.0, 2.0]));
    assert!(one.series[0].whiskers.iter().all(|w| w.is_nan()));
}

#[test]
fn pictures_are_as_high_as_their_rows() {
    let run = |node: PlotBars| with(|cx| node.run(cx)).map(|d| d.image).map_err(|e| e.message);
    let (two, four) = (run(node(vec![measures()])).unwrap(), run(node(vec![vectors(&[[1.0, 2.0]]), measures()])).unwrap());
    assert!(two.width() == 400 && four.height() > two.height() + 20);
    assert!(two.samples().chunks_exact(4).all(|p| p[3] == 1.0));
    let nothing = run(node(vec![vectors(&[[f64::NAN, f64::INFINITY]])])).unwrap();
    assert!(nothing.samples().iter().all(|v| v.is_finite()));
    let small = run(PlotBars { height: Some(10), ..node(vec![measures()]) }).err().unwrap();
    assert!(small.starts_with("expected a plot of at least "), "{small}");
}

#[test]
fn what_is_not_there_is_refused_with_its_name() {
    let fails = |node: PlotBars| plot(node).err().unwrap();
    let text = |t: &str| vec![t.to_owned()];
    assert_eq!(fails(node(Vec::new())), "values: expected at least one bar, found none");
    let column = PlotBars { column: "median".to_owned(), labels: text("lifted"), ..node(vec![measures()]) };
    assert_eq!(fails(column), "column: values `lifted`: expected a column of the table, found \"median\", which is none");
    let whisker = PlotBars { whisker: Some("p95".to_owned()), ..node(vec![measures()]) };
    assert_eq!(fails(whisker), "whisker: values 0: expected a column of the table, found \"p95\", which is none");
    assert_eq!(
        fails(PlotBars { names: text("tail"), ..node(vec![measures()]) }),
        "names: expected rows of the tables, found \"tail\", which is none"
    );
    let count = PlotBars { names: text("a"), ..node(vec![vectors(&[[1.0, 2.0]])]) };
    assert_eq!(fails(count), "names: values 0: expected a name for each of 2 bars, found 1");
    assert_eq!(fails(PlotBars { factor: f64::NAN, ..node(vec![measures()]) }), "factor: expected a number, found NaN");
    assert_eq!(
        fails(PlotBars { labels: vec![String::new(); 2], ..node(vec![measures()]) }),
        "labels: expected at most one for each of 1 values, found 2"
    );
    let uneven = counted(2, |k| Vector { values: vec![0.0; k + 1] }).0;
    assert_eq!(fails(node(vec![uneven])), "values 0: expected 1 numbers at every frame, found 2 at position 1");
    assert_eq!(fails(node(vec![counted(0, |_| Vector { values: Vec::new() }).0])), "values: expected at least one bar, found none");
}
