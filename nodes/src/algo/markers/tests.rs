use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::naming::{ACCLAIM, COLLAR, HUMAN_IK, matched};
use super::smooth::{Filter, Smooth, bridged, parts};
use super::table::{Fill, at, read_csv_markers, read_json_markers, write_csv_markers, write_json_markers};

#[test]
fn csv_is_read_in_any_order_of_rows_and_columns() {
    let text = "\u{feff}Name,y [px],x,Frame\r\nhead,2,1,5\nhip,,,5\r\n\"a, b\",-1.5,1e2,-3\nhead,4,3,6\n\n";
    let found = read_csv_markers(text).unwrap();
    assert_eq!(found.names, ["head", "hip", "a, b"]);
    assert_eq!(found.tracks[0], BTreeMap::from([(5, Some([1.0, 2.0])), (6, Some([3.0, 4.0]))]));
    assert_eq!(found.tracks[1], BTreeMap::from([(5, None)]));
    assert_eq!(found.tracks[2], BTreeMap::from([(-3, Some([100.0, -1.5]))]));
}

#[test]
fn csv_that_is_wrong_is_told_by_line_and_column() {
    let error = |text: &str| read_csv_markers(text).unwrap_err().to_string();
    let number = "expected a number, or nothing where the marker is not seen";
    let columns = "line 1, the header: expected the columns frame, name, x, y";
    for (text, truth) in [
        ("frame,name,x,y\n1,a,NaN,2\n", format!("line 2, column `x`: {number}, found `NaN`")),
        ("frame,name,x,y\n1,\"a\nb\",1,2\n2,c,1,\n", format!("line 4, column `y`: {number}, found ``")),
        ("frame,name,x,y\n1,a,1,2\n1.5,a,1,2\n", "line 3, column `frame`: expected a whole number, found `1.5`".to_owned()),
        ("frame,name,x,y\n1,,1,2\n", "line 2, column `name`: expected a name, found ``".to_owned()),
        (
            "frame,name,x,y\n1,a,1,2\n1,b,1,2\n1,a,3,4\n",
            "line 4, column `name`: expected each marker once a frame, `a` at frame 1 stands in line 2, found `a`".to_owned(),
        ),
        ("frame,name,x,y\n1,a,1\n", "line 2, the row: expected 4 cells, found 3".to_owned()),
        ("frame,name,x,y,z\n", format!("{columns}, found `z`")),
        ("frame;name;x;y\n", format!("{columns}, found `frame;name;x;y`")),
        ("frame,name,x\n", format!("{columns}, found none called y")),
        ("frame,x,x,y\n", format!("{columns}, found `x` twice")),
        ("frame,name,x [cm],y\n", "line 1, the header: expected the unit px, or none, found `cm`".to_owned()),
        ("", format!("{columns}, found none called frame, name, x, y")),
    ] {
        assert_eq!(error(text), truth, "{text}");
    }
}

#[test]
fn json_that_is_wrong_is_told_by_place() {
    let fine = r#"{"size": [64, 32], "names": ["a", "b"], "frames": [{"frame": 1, "points": [[1, 2], null]}, {"frame": 2, "points": [[3, 4], [5, 6]]}]}"#;
    let found = read_json_markers(fine).unwrap();
    assert_eq!((found.size, found.names.len()), (Some([64.0, 32.0]), 2));
    assert_eq!(found.tracks[1], BTreeMap::from([(1, None), (2, Some([5.0, 6.0]))]));
    for (from, to, truth) in [
        ("[1, 2], null", "[1, 2]", "frames[0].points: expected 2 points, one for each of the names, found 1"),
        ("\"frame\": 2", "\"frame\": 1", "frames[1].frame: expected each frame once, found 1 again"),
        ("\"a\", \"b\"", "\"a\", \"a\"", "names[1]: expected a name, each once, found \"a\""),
        ("[64, 32]", "[0, 32]", "size: expected width and height of a picture, found [0.0, 32.0]"),
        ("\"frames\"", "\"frame\"", "unknown field `frame`, expected one of `size`, `names`, `frames` at line 1 column 47"),
        ("[1, 2]", "[1, NaN]", "expected value at line 1 column 80"),
    ] {
        assert_eq!(read_json_markers(&fine.replacen(from, to, 1)).unwrap_err().to_string(), truth);
    }
}

#[test]
fn what_is_written_reads_back() {
    let names = ["left, hand", "\"q\"", "c"].map(str::to_owned);
    let frames = vec![(-1, vec![[0.1, 1e-9], [f64::NAN; 2], [1.0 / 3.0, -2e20]]), (0, vec![[0.5, 2.0], [3.0, 4.0], [f64::NAN; 2]])];
    let mut csv = Vec::new();
    write_csv_markers(&names, &frames, &mut csv).unwrap();
    let from_csv = read_csv_markers(&String::from_utf8(csv).unwrap()).unwrap();
    let mut from_json = read_json_markers(&write_json_markers(Some([8.0, 6.0]), &names, &frames).unwrap()).unwrap();
    assert_eq!(from_json.size.take(), Some([8.0, 6.0]));
    assert_eq!(from_csv, from_json);
    for (frame, points) in &frames {
        for (track, point) in from_csv.tracks.iter().zip(points) {
            let found = at(track, *frame, Fill::Nothing);
            assert!(found == *point || point[0].is_nan() && found[0].is_nan());
        }
    }
}

#[test]
fn gaps_are_filled_as_asked() {
    let track = BTreeMap::from([(2, Some([0.0, 10.0])), (3, None), (6, Some([4.0, 2.0]))]);
    let x = |fill: Fill| (0..9).map(|f| at(&track, f, fill)[0]).collect::<Vec<f64>>();
    assert_eq!(x(Fill::Hold), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 4.0, 4.0]);
    assert_eq!(x(Fill::Straight), [0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 4.0, 4.0]);
    assert_eq!(x(Fill::Nothing).iter().filter(|v| v.is_nan()).count(), 7);
    assert!(at(&BTreeMap::new(), 1, Fill::Straight)[0].is_nan());
}

/// What SciPy 1.17.1 makes of twelve numbers: `savgol_filter(y, 5, 2)` and `(y, 7, 3)` with `mode="interp"`, and lines fitted by NumPy's `lstsq` with Gaussian
/// weights of 1.5 drawings, 3 on either side.
#[test]
fn filters_are_those_of_scipy() {
    let y = [3.0, 1.0, 4.0, 1.5, 5.0, 9.0, 2.0, 6.0, 5.5, 3.5, 8.0, 9.5];
    let cases: [(Filter, f64, usize, [f64; 12]); 3] = [
        (
            Filter::SavitzkyGolay,
            5.0,
            2,
            [
                2.7857142857142856,
                2.057142857142856,
                2.1142857142857125,
                2.957142857142854,
                5.514285714285711,
                6.1285714285714255,
                5.21428571428571,
                4.414285714285711,
                5.071428571428568,
                4.999999999999996,
                6.699999999999995,
                9.899999999999995,
            ],
        ),
        (
            Filter::SavitzkyGolay,
            7.0,
            3,
            [
                3.3333333333333144,
                0.9761904761904701,
                1.7619047619047565,
                4.023809523809527,
                4.857142857142861,
                5.1666666666666705,
                5.976190476190481,
                4.690476190476195,
                4.214285714285718,
                5.607142857142861,
                7.499999999999999,
                9.39285714285713,
            ],
        ),
        (
            Filter::Gaussian,
            6.0,
            0,
            [
                2.4895803889553574,
                2.4129306546672633,
                2.8680162378847065,
                3.6527029285128285,
                4.553351090678732,
                5.135974314892773,
                5.144156310922732,
                5.1169192782919515,
                5.338347599684509,
                6.0087585708071,
                7.434247789754493,
                9.572036246627958,
            ],
        ),
    ];
    let times: Vec<f64> = (0..12).map(f64::from).collect();
    for (filter, window, degree, truth) in cases {
        let found = Smooth { window, filter, degree }.apply(&y, &times, &parts(12, &[], &[]), &[false; 12]);
        assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-12), "{filter:?}: {found:?}");
    }
}

#[test]
fn nothing_is_smoothed_across_a_cut_or_a_hold_and_straight_motion_stays() {
    let times: Vec<f64> = (0..12).map(f64::from).collect();
    let step: Vec<f64> = (0..12).map(|k| if k < 6 { 0.0 } else { 10.0 }).collect();
    let line: Vec<f64> = times.iter().map(|t| 3.0 - 2.0 * t).collect();
    for filter in [Filter::Gaussian, Filter::SavitzkyGolay] {
        let smooth = Smooth { window: 5.0, filter, degree: 2 };
        let none = [false; 12];
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 || a.is_nan() && b.is_nan());
        assert!(close(&smooth.apply(&step, &times, &parts(12, &[6], &[]), &none), &step));
        assert!(!close(&smooth.apply(&step, &times, &parts(12, &[], &[]), &none), &step));
        assert!(close(&smooth.apply(&line, &times, &parts(12, &[], &[]), &none), &line));
        // A held drawing stays where it is, and what lies beyond it is not seen.
        let (mut bump, mut held) = (line.clone(), none);
        (bump[5], held[5]) = (40.0, true);
        let mut far = bump.clone();
        far[7] = -99.0;
        let split = parts(12, &[], &[5]);
        assert_eq!(split, [0..6, 5..12]);
        let (a, b) = (smooth.apply(&bump, &times, &split, &held), smooth.apply(&far, &times, &split, &held));
        assert_eq!((a[5], &a[..6]), (40.0, &b[..6]));
        // A gap stays one, and is no neighbour.
        let mut gap = line.clone();
        gap[4] = f64::NAN;
        assert!(close(&smooth.apply(&gap, &times, &parts(12, &[], &[]), &none), &gap));
        assert!(close(&bridged(&gap, &times, &parts(12, &[], &[])), &line));
        gap[0] = f64::NAN;
        assert!(bridged(&gap, &times, &parts(12, &[4], &[]))[0].is_nan());
        assert_eq!(Smooth { window: 1.9, ..smooth }.apply(&step, &times, &parts(12, &[], &[]), &none), step);
        assert_eq!(smooth.apply(&[f64::NAN, 1.0], &times[..2], &parts(2, &[], &[]), &none)[1], 1.0);
    }
    assert_eq!(parts(0, &[], &[]), [] as [std::ops::Range<usize>; 0]);
    assert_eq!(parts(3, &[0, 1, 9], &[0, 2]), [0..1, 1..3, 2..3]);
}

#[test]
fn rigs_are_known_by_their_names_and_joints_of_no_length_are_passed_over() {
    let rig = |joints: &[(&str, [f64; 3])]| -> (Vec<String>, Vec<Vector3<f64>>) {
        joints.iter().map(|(n, p)| ((*n).to_owned(), Vector3::from(*p))).unzip()
    };
    let limbs = [
        ("LeftArm", [1.0, 5.0, 0.0]),
        ("LeftForeArm", [2.0, 5.0, 0.0]),
        ("LeftHand", [3.0, 5.0, 0.0]),
        ("RightArm", [-1.0, 5.0, 0.0]),
        ("RightForeArm", [-2.0, 5.0, 0.0]),
        ("RightHand", [-3.0, 5.0, 0.0]),
        ("LeftUpLeg", [1.0, 2.0, 0.0]),
        ("LeftLeg", [1.0, 1.0, 0.0]),
        ("LeftFoot", [1.0, 0.0, 0.0]),
        ("RightUpLeg", [-1.0, 2.0, 0.0]),
        ("RightLeg", [-1.0, 1.0, 0.0]),
        ("RightFoot", [-1.0, 0.0, 0.0]),
    ];
    let spine = [
        ("Hips", [0.0, 2.0, 0.0]),
        ("LowerBack", [0.0, 2.0, 0.0]),
        ("Spine", [0.0, 3.0, 0.0]),
        ("Spine1", [0.0, 4.0, 0.0]),
        ("Neck", [0.0, 4.0, 0.0]),
        ("Neck1", [0.0, 6.0, 0.0]),
        ("Head", [0.0, 7.0, 0.0]),
        ("LeftShoulder", [0.0, 4.0, 0.0]),
        ("RightShoulder", [0.0, 4.0, 0.0]),
    ];
    let (names, rest) = rig(&[&spine[..], &limbs[..]].concat());
    let found = matched(&[COLLAR, ACCLAIM, HUMAN_IK], &names, &rest).unwrap();
    assert_eq!((found.naming, found.missing.len()), ("HumanIK", 0));
    let joint = |marker: &str| found.joints.iter().find(|(m, _)| *m == marker).map(|(_, j)| names[*j].as_str());
    assert_eq!([joint("lower_back"), joint("neck"), joint("left_clavicle")], [Some("Spine"), Some("Neck1"), None]);
    let spaced: Vec<String> = names.iter().map(|n| format!("mixamorig:{n}")).collect();
    assert_eq!(matched(&[HUMAN_IK], &spaced, &rest).unwrap().joints, found.joints);
    let cut = matched(&[HUMAN_IK], &names[..names.len() - 1], &rest).unwrap();
    assert_eq!(cut.missing, [("right_ankle", vec!["RightFoot".to_owned()])]);
    assert_eq!(matched(&[], &names, &rest), None);
}
