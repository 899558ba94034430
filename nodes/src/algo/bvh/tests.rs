use nalgebra::Matrix4;

use super::*;
use crate::algo::skeleton::world_from_joint;
use crate::algo::text::TextError;

/// A take of two joints with their place, an end, tabs, CR LF, braces beside names, and frames over several lines.
const ODD: &str = "\u{feff}hierarchy\r\nROOT  The Hips {\r\n\tOFFSET 1 2 3\r\n\tCHANNELS 6 Zposition Yposition Xposition Yrotation Zrotation Xrotation\r\n\
    JOINT Arm\r\n{ OFFSET 0 1 0 CHANNELS 4 Xrotation Yposition Yrotation Zrotation End Site { OFFSET 0 2 0 } }\r\n\
    JOINT Arm { OFFSET 0 -1 0 CHANNELS 0 }\r\n}\r\nROOT Prop { OFFSET 0 0 5 CHANNELS 1 Zrotation\r\nEnd Site\r\n{\r\nOFFSET 1 0 0\r\n}\r\n}\r\n\
    MOTION\r\nFrames : 2\r\nFRAME TIME:\t0.0416667\r\n3 2 1\r\n0 0 0\r\n0 1 0 0\r\n0\r\n30 20 10 90 0 0 0 5 0 0 90\r\n\r\n  \r\n";

fn places(bvh: &Bvh, k: usize) -> Vec<Vector3<f64>> {
    let parents: Vec<i64> = bvh.joints.iter().map(|j| j.parent.map_or(-1, |p| p as i64)).collect();
    let local: Vec<Matrix4<f64>> = bvh.pose(k, false).iter().map(Joint::matrix).collect();
    world_from_joint(&parents, &local).unwrap().iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
}

fn close(found: &[Vector3<f64>], truth: &[[f64; 3]]) {
    assert_eq!(found.len(), truth.len());
    let worst = found.iter().zip(truth).map(|(f, t)| (f - Vector3::from(*t)).amax()).fold(0.0, f64::max);
    assert!(worst < 1e-12, "{found:?}");
}

#[test]
fn channels_are_taken_in_the_order_of_each_joint() {
    let bvh = read(ODD).unwrap();
    let names: Vec<&str> = bvh.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["The Hips", "Arm", "Arm_end", "Arm_2", "Prop", "Prop_end"]);
    assert_eq!(bvh.renamed, [("Arm".to_owned(), "Arm_2".to_owned())]);
    assert_eq!((bvh.fps, bvh.n_frames, bvh.width()), (24.0, 2, 11));
    close(&places(&bvh, 0), &[[1.0, 2.0, 3.0], [1.0, 3.0, 3.0], [1.0, 5.0, 3.0], [1.0, 1.0, 3.0], [0.0, 0.0, 5.0], [1.0, 0.0, 5.0]]);
    // A quarter turn about y; the arm at 5 of y; the prop a quarter turn about z.
    close(
        &places(&bvh, 1),
        &[[10.0, 20.0, 30.0], [10.0, 25.0, 30.0], [10.0, 27.0, 30.0], [10.0, 19.0, 30.0], [0.0, 0.0, 5.0], [0.0, 1.0, 5.0]],
    );
    assert_eq!(bvh.pose(0, true)[0].translation, Vector3::new(2.0, 4.0, 6.0), "added to the offset");
}

#[test]
fn rotations_multiply_from_left_to_right() {
    let text = |order: &str| {
        format!("HIERARCHY\nROOT a\n{{\nOFFSET 0 0 0\nCHANNELS 3 {order}\n}}\nMOTION\nFrames: 1\nFrame Time: 0.1\n20 -50 70\n")
    };
    // SciPy 1.17.1: Rotation.from_euler("ZXY" and "YZX", [20, -50, 70], degrees=True).apply([1, 2, 3]).
    for (order, truth) in [
        ("Zrotation Xrotation Yrotation", [2.5081392555606103, 2.351376288863362, -1.4765727286141468]),
        ("Yrotation Zrotation Xrotation", [0.060844797140565454, -2.1384201429982297, 3.069765007729475]),
    ] {
        let turn = read(&text(order)).unwrap().pose(0, false)[0].rotation;
        assert!(
            (turn * Vector3::new(1.0, 2.0, 3.0) - Vector3::from(truth)).amax() < 1e-14,
            "{order}: {}",
            turn * Vector3::new(1.0, 2.0, 3.0)
        );
    }
}

#[test]
fn what_is_wrong_is_said_where_it_is() {
    let fine = "HIERARCHY\nROOT a\n{\n  OFFSET 0 0 0\n  CHANNELS 2 Xrotation Yrotation\n}\nMOTION\nFrames: 2\nFrame Time: 0.1\n1 2\n3 4\n";
    assert!(read(fine).is_ok());
    let cases = [
        ("HIERARCHY", "HIERARCH", "line 1, column 1: expected HIERARCHY, found `HIERARCH`"),
        ("ROOT a", "JOINT a", "line 2, column 1: expected ROOT, found `JOINT`"),
        ("ROOT a", "ROOT", "line 2, column 5: expected a name, found the end of the line"),
        ("{\n", "\n", "line 4, column 3: expected { after `a`, found `OFFSET`"),
        ("OFFSET 0 0 0", "OFFSET 0 nan 0", "line 4, column 12: expected a number, found `nan`"),
        ("OFFSET 0 0 0", "OFFSET 0 0", "line 5, column 3: expected a number, found `CHANNELS`"),
        ("OFFSET 0 0 0\n", "\n", "line 6, column 1: expected OFFSET in `a`, found `}`"),
        ("CHANNELS 2", "CHANNELS 99999999999", "line 5, column 12: expected a number of channels from 0 to 12, found `99999999999`"),
        (
            "CHANNELS 2",
            "CHANNELS 3",
            "line 6, column 1: expected Xposition, Yposition, Zposition (each once), Xrotation, Yrotation or Zrotation, found `}`",
        ),
        ("  CHANNELS", "  OFFSET", "line 5, column 3: expected CHANNELS, JOINT, End Site, }, found `OFFSET`"),
        ("MOTION\n", "", "line 7, column 1: expected MOTION or ROOT, found `Frames:`"),
        ("Frames: 2", "Frames: 0", "line 8, column 9: expected a number of frames above 0, found `0`"),
        ("Frames: 2", "Frames:", "line 8, column 8: expected a number of frames above 0, found the end of the line"),
        ("Frames: 2", "Fames: 2", "line 8, column 1: expected Frames:, found `Fames: 2`"),
        ("Frame Time: 0.1", "Frame Time: -1", "line 9, column 13: expected the seconds of a frame, above 0, found `-1`"),
        ("Frame Time: 0.1\n", "", "line 9, column 1: expected Frame Time:, found `1 2`"),
        ("Frames: 2", "Frames: 3", "line 12, column 1: expected 3 frames of 2 numbers, found 4 numbers, which are 2 frames"),
        (
            "Frames: 2",
            "Frames: 18446744073709551615",
            "line 12, column 1: expected 18446744073709551615 frames of 2 numbers, found 4 numbers, which are 2 frames",
        ),
        ("Frames: 2", "Frames: 1", "line 12, column 1: expected 1 frames of 2 numbers, found 4 numbers, which are 2 frames"),
        ("1 2\n", "1\n", "line 10, column 1: expected 2 numbers, those of a frame, found 1"),
        ("3 4\n", "3 4 5\n", "line 11, column 1: expected 2 numbers, those of a frame, found 3"),
        ("3 4\n", "3 x\n", "line 11, column 3: expected a number, found `x`"),
        ("}\nMOTION", "MOTION", "line 6, column 1: expected JOINT, End Site, }, found `MOTION`"),
    ];
    for (from, to, truth) in cases {
        let text = fine.replacen(from, to, 1);
        assert_eq!(read(&text).unwrap_err().to_string(), truth, "{to}");
    }
    for n in 0..fine.len() - 4 {
        assert!(read(&fine[..n]).is_err(), "cut after {n} bytes");
    }
    let end = "End Site { OFFSET 0 1 0 CHANNELS 0 }";
    let error = read(&fine.replace("}\nMOTION", &format!("{end}\n}}\nMOTION"))).unwrap_err();
    assert_eq!(error.to_string(), "line 6, column 25: expected }, found `CHANNELS`");
}

#[test]
fn hostile_files_cost_no_more_than_their_length() {
    let deep = format!("HIERARCHY ROOT a\n{{ OFFSET 0 0 0 {}", "JOINT b\n{ OFFSET 0 0 0 ".repeat(MAX_JOINTS + 5));
    assert!(read(&deep).unwrap_err().to_string().ends_with("expected at most 10000 joints, found more"));
    let closed = |n: usize| format!("HIERARCHY ROOT a\n{{ OFFSET 0 0 0 {}", "JOINT b\n{ OFFSET 0 0 0 ".repeat(n)) + &"}".repeat(n + 1);
    let many = read(&(closed(300) + "MOTION\nFrames: 999999999999\nFrame Time: 1\n")).unwrap();
    assert_eq!((many.joints.len(), many.joints[300].name.as_str(), many.values.len()), (301, "b_300", 0));
    assert_eq!(many.pose(usize::MAX, false).len(), 301, "no channel, no number");
}

/// Numbers from a seed: splitmix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[test]
fn mangled_files_are_read_or_refused() {
    let pieces =
        ["{", "}", "JOINT x", "End Site", "ROOT", "MOTION", "Frames: 9", "NaN", "1e400", "\u{0}", "é", "CHANNELS 6", "-", "\r", "OFFSET"];
    let mut state = 7;
    let (mut fine, mut refused) = (0, 0);
    for _ in 0..4000 {
        let mut bytes = ODD.as_bytes().to_vec();
        for _ in 0..1 + random(&mut state) % 3 {
            let at = random(&mut state) as usize % bytes.len();
            match random(&mut state) % 4 {
                0 => bytes[at] = random(&mut state) as u8,
                1 => drop(bytes.drain(at..(at + random(&mut state) as usize % 20).min(bytes.len()))),
                2 => drop(bytes.splice(at..at, pieces[random(&mut state) as usize % pieces.len()].bytes())),
                _ => bytes.truncate(at.max(1)),
            }
            if bytes.is_empty() {
                bytes.push(b' ');
            }
        }
        match read(&String::from_utf8_lossy(&bytes)) {
            Ok(bvh) => {
                assert!(bvh.values.len() == bvh.n_frames * bvh.width() && bvh.values.iter().all(|v| v.is_finite()));
                assert!(bvh.joints.iter().enumerate().all(|(j, joint)| joint.parent.is_none_or(|p| p < j)));
                fine += 1;
            }
            Err(TextError { line, column, .. }) => {
                assert!(line >= 1 && column >= 1);
                refused += 1;
            }
        }
    }
    assert!(fine > 100 && refused > 1000, "{fine} {refused}");
}

/// A figure as [`write`] takes it.
struct Figure {
    parents: Vec<i64>,
    names: Vec<String>,
    rest: Vec<Joint>,
    frames: Vec<Vec<Joint>>,
}

impl Figure {
    fn of(bvh: &Bvh) -> Self {
        Self {
            parents: bvh.joints.iter().map(|j| j.parent.map_or(-1, |p| p as i64)).collect(),
            names: bvh.joints.iter().map(|j| j.name.clone()).collect(),
            rest: bvh.rest(),
            frames: (0..bvh.n_frames).map(|k| bvh.pose(k, false)).collect(),
        }
    }

    fn export(&self, order: Order, scale: f64) -> Export<'_> {
        let Self { parents, names, rest, frames } = self;
        Export { parents, names, rest, frames, fps: 24.0, scale, order, channels: Channels::Auto }
    }

    fn places(&self, k: usize) -> Vec<Vector3<f64>> {
        let local: Vec<Matrix4<f64>> = self.frames[k].iter().map(Joint::matrix).collect();
        world_from_joint(&self.parents, &local).unwrap().iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
    }
}

const ORDERS: [Order; 6] = [Order::Zxy, Order::Zyx, Order::Xyz, Order::Xzy, Order::Yxz, Order::Yzx];

#[test]
fn what_is_written_reads_back_and_is_written_alike() {
    let figure = Figure::of(&read(ODD).unwrap());
    for order in ORDERS {
        let text = write(&figure.export(order, 0.01)).unwrap();
        let again = Figure::of(&read(&text).unwrap());
        // The leaf without an end gets one of no length.
        assert_eq!(again.names, ["The Hips", "Arm", "Arm_end", "Arm_2", "Arm_2_end", "Prop", "Prop_end"], "{text}");
        for k in 0..2 {
            let (was, mut is) = (figure.places(k), again.places(k));
            is.remove(4);
            assert!(was.iter().zip(&is).all(|(a, b)| (a - b * 0.01).amax() < 1e-9), "{order:?} {k}: {was:?} {is:?}");
        }
        assert_eq!(write(&again.export(order, 1.0)).unwrap(), text);
    }
}

#[test]
fn a_figure_that_rests_turned_is_written_with_its_joints_in_place() {
    let joint =
        |t: [f64; 3], about: [f64; 3]| Joint { translation: t.into(), rotation: exp(&Vector3::from(about)), scale: Vector3::repeat(1.0) };
    // A child that comes before its parent, a rest of turned joints, a stretch, a scaled parent.
    let rest =
        vec![joint([0.0, 1.0, 0.0], [0.2, 0.0, 0.3]), joint([0.3, 1.0, 0.0], [0.5, -0.4, 0.1]), joint([0.0, 0.5, 0.1], [0.0, 1.2, 0.0])];
    let mut moved = rest.clone();
    moved[0].rotation *= exp(&Vector3::new(0.9, 0.1, -0.6));
    moved[1].rotation *= exp(&Vector3::new(-0.3, 0.8, 0.2));
    moved[2].translation *= 1.5;
    moved[1].scale = Vector3::new(1.0, 2.0, 1.0);
    let names = ["fore", "root", "hand"].map(str::to_owned).to_vec();
    let figure = Figure { parents: vec![1, -1, 0], names, rest: rest.clone(), frames: vec![rest, moved] };
    for order in ORDERS {
        let again = Figure::of(&read(&write(&figure.export(order, 1.0)).unwrap()).unwrap());
        for k in 0..2 {
            let (was, is) = (figure.places(k), again.places(k));
            for (j, name) in figure.names.iter().enumerate() {
                let at = again.names.iter().position(|n| n == name).unwrap();
                assert!((was[j] - is[at]).amax() < 1e-10, "{order:?} {k} {name}");
            }
        }
        assert!(again.frames[0].iter().all(|j| j.rotation.angle() < 1e-12), "nothing is turned at rest");
    }
    let refused = write(&Export { channels: Channels::Roots, ..figure.export(Order::Zxy, 1.0) }).unwrap_err();
    assert!(refused.to_string().starts_with("joint `fore`: expected it to turn alone, found it "), "{refused}");
}

#[test]
fn angles_do_not_jump_even_through_a_quarter_turn_of_the_middle_axis() {
    let about_x = |degrees: f64| turned(0, degrees);
    let rest = Joint { translation: Vector3::zeros(), rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) };
    // Four turns about x, through a middle axis at 90 degrees and beyond half a turn.
    let frames: Vec<Vec<Joint>> =
        (0..145).map(|k| vec![Joint { rotation: turned(2, 20.0) * about_x(f64::from(k) * 10.0) * turned(1, 7.0), ..rest }]).collect();
    let figure = Figure { parents: vec![-1], names: vec!["a".to_owned()], rest: vec![rest], frames };
    let bvh = read(&write(&figure.export(Order::Zxy, 1.0)).unwrap()).unwrap();
    let row = |k: usize| &bvh.values[k * 6 + 3..k * 6 + 6];
    for k in 0..145 {
        let truth = [20.0, f64::from(k as u32) * 10.0, 7.0];
        let away = row(k).iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Where the middle axis is upright the outer two are one, so that only their sum is known.
        if (k % 18) == 9 {
            continue;
        }
        assert!(away < 1e-6, "{k}: {:?} {truth:?}", row(k));
    }
    for k in 0..145 {
        assert!(bvh.pose(k, false)[0].rotation.angle_to(&figure.frames[k][0].rotation) < 1e-9, "{k}");
    }
}

#[test]
fn what_cannot_be_written_is_refused() {
    let figure = Figure::of(&read(ODD).unwrap());
    let export = figure.export(Order::Zxy, 1.0);
    assert_eq!(write(&Export { frames: &[], ..export }), Err(BvhWriteError::Empty { joints: 6, frames: 0 }));
    assert!(matches!(write(&Export { frames: &[vec![]], ..export }), Err(BvhWriteError::Counts { .. })));
    assert!(matches!(write(&Export { names: &[], ..export }), Err(BvhWriteError::Counts { .. })));
    let names = ["a", "b", "c", "d", "e", "}"].map(str::to_owned);
    assert_eq!(write(&Export { names: &names, ..export }), Err(BvhWriteError::Name { name: "}".to_owned() }));
    assert!(matches!(write(&Export { parents: &[1, 0, -1, -1, -1, -1], ..export }), Err(BvhWriteError::Tree(_))));
    let mut broken = figure.frames.clone();
    broken[1][1].translation.x = f64::NAN;
    assert!(matches!(write(&Export { frames: &broken, ..export }), Err(BvhWriteError::NotFinite { frame: 1, .. })));
}

/// File, joints, frames, a frame from 0, and the sum of all joints' places there, the k-th of the file k times: forward kinematics in NumPy 2, written from
/// the format's description, with 4 by 4 matrices. bvhio 1.5.4 reads all of them within 2.5e-7 of their size of those figures, and Blender 4.2.23 the files that
/// are written here within 3.3e-7: both compute in 32 bits.
const TAKES: [(&str, usize, usize, usize, [f64; 3]); 18] = [
    ("ad_dab.bvh", 34, 339, 113, [-4751.063624861158, 1862.7095424088234, 11268.869604302723]),
    ("ad_dab.bvh", 34, 339, 338, [-3261.87717771692, 1087.9933364585386, 11731.89893238519]),
    ("ad_jesse_dance.bvh", 73, 1007, 335, [-45037.68084057161, 285684.38994081964, -345276.74141496]),
    ("ad_jesse_dance.bvh", 73, 1007, 1006, [-81453.29689659846, 331618.8325862864, -477847.1636185369]),
    ("ad_jumping.bvh", 34, 654, 218, [-2319.670540136883, -27898.238727020238, 11674.558321213482]),
    ("ad_jumping.bvh", 34, 654, 653, [1227.9270247746974, 7046.082980365239, 10934.62115591326]),
    ("bvh_anim_test_simple.bvh", 3, 2, 0, [0.0, 0.0, 165.0]),
    ("bvh_anim_test_simple.bvh", 3, 2, 1, [10.553283586805106, 1.6579706099925842, 170.86753007106446]),
    ("cmu_01_01.bvh", 38, 2752, 917, [6703.747183146945, 12670.060203623627, 34322.452764015936]),
    ("cmu_01_01.bvh", 38, 2752, 2751, [6234.103734992178, 12718.207526455855, 29947.119119021743]),
    ("cmu_10_02_kick.bvh", 24, 149, 49, [6562.738927978789, 12460.879874573551, -12286.823962882381]),
    ("cmu_10_02_kick.bvh", 24, 149, 148, [7476.746118093249, 12526.25381781252, 7606.417293010645]),
    ("cmu_37_01_slow_walk.bvh", 24, 129, 43, [-1679.2354378989269, 12446.221768737629, -5026.822676900037]),
    ("cmu_37_01_slow_walk.bvh", 24, 129, 128, [-609.8353263722414, 12020.12754575717, 28772.224043429174]),
    ("cmu_jumping_jacks.bvh", 38, 125, 41, [-2187.226931267938, 14618.061526475085, 671.6456419225307]),
    ("cmu_jumping_jacks.bvh", 38, 125, 124, [-1065.0015733854111, 11766.70910901315, 972.0052522710287]),
    ("pymo_8walk_meredith.bvh", 30, 1064, 354, [24728.932958740465, 11118.373097490365, -7772.582922169349]),
    ("pymo_8walk_meredith.bvh", 30, 1064, 1063, [-8765.062114449785, 11769.32924369328, -74605.73783911989]),
];

/// Takes are no part of the project: where the folder `shared/data/mocap` does not lie next to it the test says so and passes.
#[test]
fn takes_of_many_makers_stand_as_they_do_elsewhere_and_after_they_are_written() {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/mocap"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no folder {}", folder.display());
        return;
    }
    for (name, joints, n_frames, k, truth) in TAKES {
        let bvh = read(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap();
        assert_eq!((bvh.joints.len(), bvh.n_frames, bvh.renamed.len()), (joints, n_frames, 0), "{name}");
        assert!([30.0, 100.0, 120.0, 120_000.0 / 1001.0].contains(&bvh.fps), "{name}: {}", bvh.fps);
        let found = places(&bvh, k).iter().enumerate().map(|(j, p)| p * (j + 1) as f64).sum::<Vector3<f64>>();
        assert!((found - Vector3::from(truth)).amax() < 1e-9 * found.amax(), "{name} {k}: {found}");
        let figure = Figure { frames: vec![bvh.pose(k, false), bvh.pose(k / 2, false)], ..Figure::of(&bvh) };
        let text = write(&figure.export(Order::Zxy, 1.0)).unwrap();
        let again = Figure::of(&read(&text).unwrap());
        for f in 0..2 {
            let (was, is) = (figure.places(f), again.places(f));
            for (j, place) in was.iter().enumerate() {
                let at = again.names.iter().position(|n| *n == figure.names[j]).unwrap();
                assert!((place - is[at]).amax() < 1e-9, "{name} {k} {}: {}", figure.names[j], (place - is[at]).amax());
            }
        }
        // Once more: half a turn may be written with either sign, so that places are compared.
        let third = Figure::of(&read(&write(&again.export(Order::Zxy, 1.0)).unwrap()).unwrap());
        assert_eq!((&third.names, &third.parents, &third.rest), (&again.names, &again.parents, &again.rest), "{name}");
        let away = (0..2).flat_map(|f| again.places(f).into_iter().zip(third.places(f))).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        assert!(away < 1e-9, "{name}: {away}");
    }
}
