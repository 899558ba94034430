//! Values and tables in and out.

use pegbar_engine::value::{ValueRef, digest, downcast};

use super::{Stage, only_failure};
use crate::data::{KeyShapes, Weights};

/// Files made by NumPy 2 (`numpy.savez`): `points` f64 [2, 3, 2] = arange(12); and `weights` f32 [3, 2] with `frames` i64 [3] = 1, 2, 4.
const KEYS: &[u8] = include_bytes!("testdata/keys.npz");
const WEIGHTS: &[u8] = include_bytes!("testdata/weights.npz");

fn digests(values: &[ValueRef]) -> Vec<String> {
    values.iter().map(|v| digest(v.as_ref()).to_string()).collect()
}

#[test]
fn a_value_that_numpy_wrote_is_read_written_and_read_again() {
    let stage = Stage::new();
    stage.put("keys.npz", KEYS);
    let read = r#""in": (type: "io.read_value", path: "keys.npz", as: "KeyShapes")"#;
    let values = stage.values((1, 3), read, "in").unwrap();
    let keys = downcast::<KeyShapes>(values[0].clone()).unwrap();
    assert_eq!((values.len(), keys.points.shape()), (1, [2, 3, 2]));
    assert_eq!(keys.points.data(), (0..12).map(f64::from).collect::<Vec<_>>());
    let report = stage.run((1, 3), &format!(r#"{read}, "w": (type: "io.write_value", value: "@in", path: "k.npz", compress: true)"#));
    assert!(report.is_complete(), "{:#?}", report.failures);
    let back = stage.values((1, 3), r#""in": (type: "io.read_value", path: "out/k.npz", as: "KeyShapes")"#, "in").unwrap();
    assert_eq!(digests(&back), digests(&values));
}

#[test]
fn a_file_with_frames_is_a_stream() {
    let stage = Stage::new();
    stage.put("weights.npz", WEIGHTS);
    let read = |missing: &str| format!(r#""in": (type: "io.read_value", path: "weights.npz", as: "Weights", missing: {missing})"#);
    let first = |frames, missing: &str| -> Vec<f64> {
        let values = stage.values(frames, &read(missing), "in").unwrap();
        values.into_iter().map(|v| downcast::<Weights>(v).unwrap().weights[0]).collect()
    };
    // Singles widen to the doubles that the type has.
    assert_eq!(first((1, 2), "error"), [0.0, 2.0]);
    assert_eq!(first((1, 4), "hold"), [0.0, 2.0, 2.0, 4.0]);
    assert_eq!(first((0, 5), "nearest"), [0.0, 0.0, 2.0, 2.0, 4.0, 4.0]);
    let report = stage.run((2, 3), &format!(r#"{}, "w": (type: "io.write_value", value: "@in", path: "w.npz")"#, read("error")));
    let message = only_failure(&report, &stage.path("weights.npz"));
    assert!(message.ends_with("expected frame 3, found 3 frames from 1 to 4"), "{message}");
    assert!(stage.written().is_empty());
}

#[test]
fn a_stream_is_written_as_one_file_or_one_a_frame() {
    let stage = Stage::new();
    stage.put("weights.npz", WEIGHTS);
    let read = r#""in": (type: "io.read_value", path: "weights.npz", as: "Weights", missing: hold),"#;
    let report = stage.run((1, 4), &format!(
        r#"{read} "one": (type: "io.write_value", value: "@in", path: "w.npz"), "each": (type: "io.write_value", value: "@in", path: "w.####.npz")"#
    ));
    assert!(report.is_complete(), "{:#?}", report.failures);
    assert_eq!(stage.written(), ["w.0001.npz", "w.0002.npz", "w.0003.npz", "w.0004.npz", "w.npz"]);
    let expected = digests(&stage.values((1, 4), read, "in").unwrap());
    for path in ["w.npz", "w.####.npz"] {
        let back = stage.values((1, 4), &format!(r#""in": (type: "io.read_value", path: "out/{path}", as: "Weights")"#), "in").unwrap();
        assert_eq!(digests(&back), expected);
    }
}

#[test]
fn value_files_that_cannot_be_are_one_error() {
    let stage = Stage::new();
    for (name, bytes) in [("cut.npz", &KEYS[..KEYS.len() / 2]), ("empty.npz", &[]), ("other.npz", WEIGHTS)] {
        stage.put(name, bytes);
        let report = stage.run((1, 2), &format!(
            r#""in": (type: "io.read_value", path: "{name}", as: "KeyShapes"), "w": (type: "io.write_value", value: "@in", path: "x.####.npz")"#
        ));
        assert!(!report.is_complete());
        assert!(
            report.failures.iter().all(|f| f.error.message.contains(name) && f.error.message.contains("expected")),
            "{:#?}",
            report.failures
        );
        assert!(stage.written().is_empty());
    }
    let error = |nodes: &str| stage.load((1, 2), nodes).err().unwrap();
    assert_eq!(error(r#""in": (type: "io.read_value", path: "other.npz", as: "Weight")"#), ["expected a value type, found `Weight`"]);
    let wrong = error(
        r#""in": (type: "io.read_value", path: "other.npz", as: "Weights"), "w": (type: "io.write_value", value: "@in", path: "x.txt")"#,
    );
    assert_eq!(wrong, ["expected a path ending in .npz, found x.txt"]);
}

#[test]
fn numbers_are_written_as_a_table() {
    let stage = Stage::new();
    stage.put("weights.npz", WEIGHTS);
    stage.put("keys.npz", KEYS);
    let nodes = r#""in": (type: "io.read_value", path: "weights.npz", as: "Weights", missing: hold),
        "keys": (type: "io.read_value", path: "keys.npz", as: "KeyShapes"),
        "t": (type: "io.write_table", values: ["@in", "@in", "@keys"], names: ["weight"], units: ["", "px"], path: "t.csv"),
        "s": (type: "io.write_table", values: "@keys", path: "s.csv")"#;
    let report = stage.run((1, 3), nodes);
    assert!(report.is_complete(), "{:#?}", report.failures);
    let text = std::fs::read_to_string(stage.path("out/t.csv")).unwrap();
    let mut lines = text.lines();
    assert!(
        lines
            .next()
            .unwrap()
            .starts_with("frame,weight[0],weight[1],weights[0] [px],weights[1] [px],keyshapes[0][0][0],keyshapes[0][0][1],")
    );
    assert_eq!(lines.next().unwrap(), "1,0,0.5,0,0.5,0,1,2,3,4,5,6,7,8,9,10,11");
    assert_eq!(lines.nth(1).unwrap(), "3,2,2.5,2,2.5,0,1,2,3,4,5,6,7,8,9,10,11");
    let single = std::fs::read_to_string(stage.path("out/s.csv")).unwrap();
    assert_eq!(single.lines().count(), 2);
    assert!(single.ends_with("\r\n0,1,2,3,4,5,6,7,8,9,10,11\r\n"));
    let error = stage.load((1, 3), r#""in": (type: "io.read_value", path: "weights.npz", as: "Weights"), "t": (type: "io.write_table", values: "@in", path: "t.####.txt")"#);
    assert_eq!(error.err().unwrap().len(), 2);
}
