use nalgebra::Matrix4;

use super::*;
use crate::algo::skeleton::world_from_joint;

const ASF: &str = "# a figure\n:version 1.10\n:name VICON\n:units\n  mass 1.0\n  length 0.45\n  angle deg\n:documentation\n  any words: here\n:root\n  \
    order TX TY TZ RX RY RZ\n  axis XYZ\n  position 0.5 1 -0.5\n  orientation 0 30 0\n:bonedata\n\
    begin\n id 1\n name lowerback\n direction 0.01 0.99 -0.1\n length 2.0\n axis 0 0 0 XYZ\n dof rx ry rz\n limits (-20.0 45.0)\n (-30.0 30.0)\n (-30.0 30.0)\n end\n\
    begin\n id 2\n name lfoot # comes before its parent\n direction 0.06 -0.2 0.97\n length 2.1\n axis -90 3 20 XYZ\n dof rz rx\n end\n\
    begin\n id 3\n name lfemur\n direction 0.34 -0.94 0.02\n length 7.2\n axis 0 0 20 XYZ\n dof rx ry rz\n end\n\
    begin\n id 4\n name ltibia\n direction 0.33 -0.93 0.1\n length 7.1\n axis 5 -10 20 ZYX\n dof rx\n end\n\
    begin\n id 5\n name head\n direction 0 1 0.1\n length 1.6\n axis 1 2 3 YZX\n dof rz ry rx\n end\n\
    begin\n id 6\n name stub\n direction 1 0 0\n length 1\n axis 0 0 0 XYZ\n end\n\
    :hierarchy\n begin\n root lowerback lfemur stub\n ltibia lfoot\n lfemur ltibia\n lowerback head\n end\n";

const AMC: &str = "#!OML:ASF figure\r\n:FULLY-SPECIFIED\r\n:DEGREES\r\n1\r\nroot 1 2 3 10 20 30\r\nlowerback 5 -6 7\r\nlfemur -30 10 5\r\nltibia 40\r\n\
    lfoot 12 -8\r\nhead 1 2 3\r\n2\r\nhead -40 22 31\r\nroot -4 17 3.5 -100 70 200\r\nlowerback 15 26 -37\r\nlfemur -80 20 15\r\nltibia 95\r\nlfoot -22 18\r\n";

/// Forward kinematics of the two frames in NumPy 2, written by itself: M of each bone by 3 by 3 matrices, first axis first; lengths divided by 0.45.
const TRUTH: [[(&str, [f64; 3]); 6]; 2] = [
    [
        ("lfemur", [3.3333333333333335, 6.666666666666667, 5.555555555555555]),
        ("ltibia", [16.340860100415846, -2.6122297629040228, 6.332683893047076]),
        ("lfoot", [26.742833848184695, -10.732747329435583, -2.0793080355818567]),
        ("head", [1.5715454145793781, 10.354263500437568, 7.245892531940715]),
        ("lfoot_end", [30.271742176723446, -10.82358314050134, 0.9171527244515665]),
        ("head_end", [0.4139347861593303, 12.968459198879716, 9.389327519278543]),
    ],
    [
        ("lfemur", [-7.777777777777779, 40.0, 6.666666666666666]),
        ("ltibia", [0.8131279829097249, 27.0690494881661, 2.8086286845455786]),
        ("lfoot", [-12.28690795763847, 18.50806668223158, 2.744571227701525]),
        ("head", [-6.898645873434851, 39.58288858773416, 2.3524284561173845]),
        ("lfoot_end", [-12.48100203560344, 13.881778063046566, 2.742748284922687]),
        ("head_end", [-8.209319990394874, 37.02152718512236, 0.23347678463689325]),
    ],
];

fn places(asf: &Asf, motion: &Amc, k: usize) -> Vec<Vector3<f64>> {
    let local: Vec<Matrix4<f64>> = asf.pose(motion, k).iter().map(Joint::matrix).collect();
    world_from_joint(&asf.joints().0, &local).unwrap().iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect()
}

#[test]
fn bones_stand_as_they_do_elsewhere() {
    let asf = read_asf(ASF).unwrap();
    let motion = read_amc(AMC, &asf).unwrap();
    assert_eq!((motion.n_frames, asf.width(), asf.is_radians), (2, 18, false));
    let (_, names) = asf.joints();
    for (k, truth) in TRUTH.iter().enumerate() {
        let found = places(&asf, &motion, k);
        for (name, place) in truth {
            let joint = names.iter().position(|n| n == name).unwrap();
            assert!((found[joint] - Vector3::from(*place)).amax() < 1e-12, "{k} {name}: {}", found[joint]);
        }
    }
}

#[test]
fn radians_are_degrees() {
    let asf = read_asf(ASF).unwrap();
    let turned = |text: &str| read_amc(text, &asf).unwrap().values;
    let short = |unit: &str, angle: f64| {
        let a = angle;
        format!(":{unit}\n1\nroot 1 2 3 {a} 0 0\nlowerback 0 0 0\nlfemur 0 0 0\nltibia {a}\nlfoot 0 0\nhead 0 0 0\n")
    };
    let (a, b) = (turned(&short("DEGREES", 90.0)), turned(&short("RADIANS", std::f64::consts::FRAC_PI_2)));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
    let in_radians = ASF.replace("angle deg", "angle rad").replace("orientation 0 30 0", "orientation 0 0.5235987755982988 0");
    let found = read_asf(&in_radians).unwrap();
    assert!(found.is_radians && found.bones[0].axes.angle_to(&asf.bones[0].axes) < 1e-12);
}

#[test]
fn what_is_wrong_is_said_where_it_is() {
    let refused = |from: &str, to: &str| read_asf(&ASF.replacen(from, to, 1)).unwrap_err().to_string();
    for (from, to, truth) in [
        ("length 0.45", "length 0", "line 6, column 10: expected a length above 0, found `0`"),
        ("angle deg", "angle grad", "line 7, column 9: expected deg or rad, found `grad`"),
        ("axis XYZ", "axis XXZ", "line 12, column 8: expected an order of axes as XYZ, found `XXZ`"),
        ("dof rx ry rz", "dof rx l", "line 22, column 9: expected rx, ry or rz, each once, found `l`"),
        ("dof rx ry rz", "dof rx rx", "line 22, column 9: expected each degree of freedom once, found `rx`"),
        ("direction 0.01 0.99 -0.1", "direction 0.01 0.99", "line 19, column 2: expected 3 numbers after `direction`, found 2"),
        ("name lowerback", "name lfoot", "line 34, column 2: expected a name of the bone, unlike every other, found `lfoot`"),
        ("lowerback lfemur stub", "lowerback lfemur tail", "line 68, column 24: expected a bone of :bonedata, each once, found `tail`"),
        (
            "lowerback lfemur stub",
            "lowerback lfemur",
            "line 73, column 1: expected :hierarchy with a parent for each bone, found the end of the file",
        ),
        ("lfemur ltibia", "lfoot ltibia", "line 73, column 1: expected :hierarchy with a parent for each bone, found the end of the file"),
        (":root", ":roots", "line 73, column 1: expected :root, found the end of the file"),
        ("begin", "begins", "line 16, column 1: expected begin, found `begins`"),
    ] {
        assert_eq!(refused(from, to), truth, "{to}");
    }
    let asf = read_asf(ASF).unwrap();
    let refused = |from: &str, to: &str| read_amc(&AMC.replacen(from, to, 1), &asf).unwrap_err().to_string();
    for (from, to, truth) in [
        ("ltibia 40", "ltibia nan", "line 8, column 8: expected a number, found `nan`"),
        ("ltibia 40", "ltibia 40 1", "line 8, column 1: expected 1 numbers of `ltibia`, once a frame, found 2"),
        ("ltibia 40", "tail 40", "line 8, column 1: expected a bone of the skeleton, or the number of a frame, found `tail`"),
        ("ltibia 40\r\n", "", "line 10, column 1: expected `ltibia` in the frame before it, found `2`"),
        ("head 1 2 3", "ltibia 3", "line 10, column 1: expected 1 numbers of `ltibia`, once a frame, found 1"),
        ("1\r\nroot", "root", "line 4, column 1: expected the number of a frame, found `root`"),
        ("lfoot -22 18\r\n", "", "line 17, column 1: expected `lfoot` in the frame before it, found the end of the file"),
    ] {
        assert_eq!(refused(from, to), truth, "{to}");
    }
    assert_eq!(
        read_amc(":DEGREES\n", &asf).unwrap_err().to_string(),
        "line 2, column 1: expected at least one frame, found the end of the file"
    );
    for n in 0..ASF.len() {
        let _ = read_asf(&ASF[..n]);
    }
}
