use nalgebra::{Matrix4, Vector3};

use super::*;
use crate::algo::camera::{Camera, Orbit, orthographic, perspective};

type Pose = Vec<Vector3<f64>>;

const N: usize = 24;
const PARENTS: [usize; N] = [0, 0, 1, 2, 3, 3, 5, 6, 7, 3, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19, 4, 8, 12];
const SIZE: [usize; 2] = [640, 480];

/// Numbers that every language makes alike: Knuth's congruential generator, its upper 53 bits, about 0.
struct Rng(u64);

impl Rng {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next())
    }
}

fn limbs() -> Vec<[usize; 2]> {
    (1..N).map(|j| [PARENTS[j], j]).collect()
}

/// Looks along (0.64, -0.6, 0.48), 100 pixels a metre.
fn camera() -> Camera {
    let view = Matrix4::new(0.6, 0.0, -0.8, 0.0, 0.48, 0.8, 0.36, 0.0, 0.64, -0.6, 0.48, 0.0, 0.0, 0.0, 0.0, 1.0);
    Camera::new(view, orthographic(100.0, SIZE, -10.0, 10.0), SIZE.map(|n| n as i64)).unwrap()
}

fn drawn(camera: &Camera, pose: &[Vector3<f64>], rng: &mut Rng, off: f64) -> Vec<[f64; 2]> {
    let one = |p: &Vector3<f64>| {
        let [x, y, _] = camera.project((*p).into());
        [x + 100.0 * off * rng.next(), y - 100.0 * off * rng.next()]
    };
    pose.iter().map(one).collect()
}

/// A figure, its drawing with limbs of other lengths, and a space of poses that it is not in.
fn scene() -> Frame {
    let mut rng = Rng(42);
    let mut prior = vec![Vector3::zeros(); N];
    (1..N).for_each(|j| prior[j] = prior[PARENTS[j]] + rng.vector() * 0.5);
    let camera = camera();
    let markers = drawn(&camera, &prior, &mut rng, 0.1);
    let lengths = (1..N).map(|j| (prior[j] - prior[PARENTS[j]]).norm() * (0.8 + 0.4 * (rng.next() + 0.5))).collect();
    let mut columns = vec![vec![0.0; 3 * N]; 5];
    (0..3 * N).for_each(|r| columns.iter_mut().for_each(|c| c[r] = rng.next()));
    for k in 0..5 {
        for e in 0..k {
            let along: f64 = columns[e].iter().zip(&columns[k]).map(|(a, b)| a * b).sum();
            let earlier = columns[e].clone();
            columns[k].iter_mut().zip(&earlier).for_each(|(a, b)| *a -= along * b);
        }
        let length = columns[k].iter().map(|v| v * v).sum::<f64>().sqrt();
        columns[k].iter_mut().for_each(|v| *v /= length);
    }
    let mean: Vec<f64> = prior.iter().flat_map(|p| <[f64; 3]>::from(p + rng.vector() * 0.2)).collect();
    let stand = Stand::new(Framing::World, &prior, 0, [1, 2]).unwrap();
    let components: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let subspace = Some(Subspace::placed(&mean, &components, Framing::World, &stand));
    Frame { markers, prior, lengths: Some(lengths), camera, subspace }
}

fn lifted(frames: &[Frame], limbs: &[[usize; 2]], options: Options, basis_mode: BasisMode) -> Vec<Lifted> {
    let tree = Tree::new(frames[0].prior.len(), limbs).unwrap();
    Lift { tree: &tree, options, basis_mode }.run(frames).unwrap()
}

fn near(found: &[Vector3<f64>], truth: [f64; 6], sum: f64, name: &str) {
    let flat: Vec<f64> = found.iter().flat_map(|p| <[f64; 3]>::from(*p)).collect();
    for (k, t) in [0, 1, 2, 33, 47, 71].into_iter().zip(truth) {
        assert!((flat[k] - t).abs() < 1e-9, "{name}, coordinate {k}: {} {t}", flat[k]);
    }
    let all: f64 = flat.iter().zip(1..).map(|(x, k)| x * f64::from(k)).sum();
    assert!((all - sum).abs() < 1e-7, "{name}: {all} {sum}");
}

/// `numpy.linalg.lstsq` of NumPy 2.3 on the stacked, weighted rows of equation 10 (after 16, of `A C`): coordinates 0, 1, 2, 33, 47 and 71, and the sum of all,
/// each times its number from 1.
#[test]
fn as_numpy_has_it() {
    use BasisMode::{Hard, Off, Soft};
    let paper = Options::PAPER;
    let mut unseen = scene();
    [3, 7, 23].into_iter().for_each(|m| unseen.markers[m] = [f64::NAN; 2]);
    let mut ringed = limbs();
    ringed.push([4, 13]);
    let mut ring = scene();
    let closing = (ring.prior[13] - ring.prior[4]).norm() * 0.1_f64.sqrt();
    ring.lengths.as_mut().unwrap().push(closing);
    let strong = Options { length_weight: 0.5, ..paper };
    let scaled = Options { length_weight: 5.0, rows: LimbRows::Scaled, ..paper };
    #[rustfmt::skip]
    let cases = [
        ("sqrt", scene(), limbs(), paper, Off, [-0.00010338489600062818, 0.026398798169646086, 0.03323394050660433, 0.005069246462417687, 0.39574031671042686, -0.3182724850738512], -387.44342957930246),
        ("literal", scene(), limbs(), Options { weighting: Weighting::Literal, ..paper }, Off, [-0.00014132011661222068, 0.028787364367755794, 0.036173696265099864, 0.004218167311446752, 0.3960523071547829, -0.3186113712779584], -386.46776864796277),
        ("scaled", scene(), limbs(), scaled, Off, [0.0559764773974579, -0.029417309913133793, 0.0661919951386837, 0.04549162880271216, 0.36404209671967763, -0.2793339508748266], -388.9401058824641),
        ("missing", unseen, limbs(), strong, Off, [0.010775090489066372, 0.01357765149843805, 0.040627075754360475, 0.023444185088137948, 0.38613232502844586, -0.3010815904566394], -395.11598651607886),
        ("hard", scene(), limbs(), paper, Hard, [0.05209391731826527, -0.0025895298893662023, 0.06819038598839836, 0.11038919149319565, 0.352206578598084, -0.2401102134312071], -410.08359575168026),
        ("soft", scene(), limbs(), Options { basis_weight: 0.3, ..paper }, Soft, [0.038457810428050854, -0.004198271776846083, 0.058751122279739165, 0.050554468195162405, 0.39543782455334703, -0.28237732120311904], -389.5312684891574),
        ("ring", ring, ringed, strong, Off, [0.009242099155425633, 0.017925056121739037, 0.034546714933515354, 0.019982687186329597, 0.3844450489310285, -0.3055716477320165], -392.1466585634787),
    ];
    for (name, frame, limbs, options, mode, truth, sum) in cases {
        near(&lifted(&[frame], &limbs, options, mode)[0].markers, truth, sum, name);
    }
}

/// Roots of the traces of the diagonal blocks of `inv(AᵀA)`, NumPy 2.3.
#[test]
fn how_sure_markers_are_is_what_numpy_says() {
    let found = &lifted(&[scene()], &limbs(), Options { length_weight: 0.5, ..Options::PAPER }, BasisMode::Off)[0].uncertainty;
    let truth = [3.207272045380383, 2.639897858440464, 2.8943441820161775, 3.3962568318121344];
    assert!([0, 3, 12, 23].into_iter().zip(truth).all(|(m, t)| (found[m] - t).abs() < 1e-9), "{found:?}");
}

/// Six frames that speed up.
fn moving() -> Vec<Frame> {
    let (still, mut rng) = (scene(), Rng(7));
    let frame = |f: i32| {
        let f = f64::from(f);
        let prior: Pose = still.prior.iter().map(|p| p + Vector3::new(0.05 * f, 0.0, 0.02 * f * f)).collect();
        let markers = drawn(&still.camera, &prior, &mut rng, 0.1);
        Frame { markers, prior, subspace: None, ..still.clone() }
    };
    (0..6).map(frame).collect()
}

/// `numpy.linalg.lstsq` on the rows of all frames and of their second differences at once.
#[test]
fn frames_together_are_as_numpy_has_them() {
    let options = Options { length_weight: 0.5, smooth_weight: 2.0, ..Options::PAPER };
    let found = lifted(&moving(), &limbs(), options, BasisMode::Off);
    #[rustfmt::skip]
    let truth = [
        (0, [0.01482011797723748, 0.007112241423454071, 0.010618734559445833, 0.006787761847011699, 0.3964051372004888, -0.3063815177691695], -399.3575199701843),
        (2, [0.09433162865254788, -0.012719058887518286, 0.08076973518979116, 0.1176515951252039, 0.4649953002523098, -0.22583058723624883], -245.935883415854),
        (5, [0.26757445612003006, -0.003010038638895228, 0.4711662704786317, 0.28783525710181934, 0.9002966536069459, 0.1730700693038989], 273.77242499481383),
    ];
    for (k, truth, sum) in truth {
        near(&found[k].markers, truth, sum, "frame");
    }
}

#[test]
fn lengths_are_kept_exactly_where_that_is_asked_for() {
    let base = Options { length_weight: f64::INFINITY, relinearize: 30, ..Options::PAPER };
    for options in [base, Options { smooth_weight: 1.0, ..base }, Options { depth_weight: 0.5, ..base }] {
        let mut frames = moving();
        // Lengths of the capture itself: a rigid figure.
        frames.iter_mut().for_each(|f| f.lengths = None);
        for found in lifted(&frames, &limbs(), options, BasisMode::Off) {
            assert!(found.length_error < 1e-12, "{options:?} {}", found.length_error);
            assert!(found.residual < 12.0, "{options:?} {}", found.residual);
        }
    }
}

/// A figure that stands in the capture and bounces in the drawing, with a centimetre of noise: tremble is what the second differences of the error hold.
#[test]
fn tremble_goes_and_bounces_stay() {
    let (mut rng, frame, camera) = (Rng(3), scene(), camera());
    let height = |t: usize| {
        let s = (t % 16) as f64 / 16.0;
        0.6 * 4.0 * s * (1.0 - s)
    };
    let n = 97;
    let truth: Vec<Pose> = (0..n).map(|t| frame.prior.iter().map(|p| p + Vector3::y() * height(t)).collect()).collect();
    let noise = |v: f64, rng: &mut Rng| v + (0..12).map(|_| rng.next()).sum::<f64>();
    let frames: Vec<Frame> = truth
        .iter()
        .map(|pose| {
            let markers = drawn(&camera, pose, &mut Rng(1), 0.0).iter().map(|p| p.map(|v| noise(v, &mut rng))).collect();
            Frame { markers, lengths: None, subspace: None, ..frame.clone() }
        })
        .collect();
    let clean = |f: &Frame, pose: &Pose| Frame { markers: drawn(&camera, pose, &mut Rng(1), 0.0), ..f.clone() };
    let clean: Vec<Frame> = frames.iter().zip(&truth).map(|(f, pose)| clean(f, pose)).collect();
    let lift = |frames: &[Frame], smooth_weight: f64, accents: f64| -> Vec<Vec<f64>> {
        let options = Options { smooth_weight, accents, ..Options::PAPER };
        let flat = |l: Lifted| l.markers.iter().flat_map(|p| <[f64; 3]>::from(*p)).collect();
        lifted(frames, &limbs(), options, BasisMode::Off).into_iter().map(flat).collect()
    };
    let real = lift(&clean, 0.0, 0.0);
    let measured = |smooth_weight: f64, accents: f64| {
        let found = lift(&frames, smooth_weight, accents);
        let off: Vec<Vec<f64>> = found.iter().zip(&real).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
        let row = |shape: &[f64]| shape.iter().skip(1).step_by(3).sum::<f64>() / N as f64;
        let whole = row(&real[24]) - row(&real[16]);
        let loss = [24, 32].map(|t: usize| (row(&found[t]) - row(&real[t])).abs() / whole);
        (crate::algo::smoothness::bends(&off).iter().sum::<f64>(), loss)
    };
    let (raw, _) = measured(0.0, 0.0);
    let (kept, [top, contact]) = measured(1.0, 3.0);
    println!("tremble {raw:.3} to {kept:.3}, {:.1} times less; the top loses {top:.4}, the contact {contact:.4}", raw / kept);
    assert!(raw > 5.0 * kept && top < 0.05 && contact < 0.05, "{raw} {kept} {top} {contact}");
    // All bends at one price round the contact off, and that is an error that bends.
    let (plain, [_, contact]) = measured(1.0, 0.0);
    println!("without accents {plain:.3}, the contact {contact:.4}");
    assert!(contact > 0.05 && plain > 2.0 * kept, "{contact} {plain} {kept}");
}

#[test]
fn a_figure_that_is_drawn_as_it_was_captured_stays() {
    let mut frame = scene();
    frame.markers = drawn(&frame.camera, &frame.prior, &mut Rng(1), 0.0);
    frame.lengths = None;
    for options in
        [Options::PAPER, Options { length_weight: f64::INFINITY, depth_weight: 1.0, stretch: 1.0, relinearize: 3, ..Options::PAPER }]
    {
        let found = &lifted(std::slice::from_ref(&frame), &limbs(), options, BasisMode::Off)[0];
        let off = found.markers.iter().zip(&frame.prior).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(off < 1e-9 && found.residual < 1e-9, "{off}");
    }
}

#[test]
fn perspective_comes_to_lie_on_what_is_drawn() {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.5, elevation: 0.2, roll: 0.0, distance: 3.0 };
    let camera = Camera::new(orbit.view(), perspective(0.8, SIZE, 0.1, 100.0), SIZE.map(|n| n as i64)).unwrap();
    let frame = scene();
    let truth: Pose = frame.prior.iter().map(|p| p * 1.1 + Vector3::new(0.05, -0.02, 0.1)).collect();
    let markers = drawn(&camera, &truth, &mut Rng(1), 0.0);
    let lengths = limbs().iter().map(|[a, b]| (truth[*b] - truth[*a]).norm()).collect();
    let frame = Frame { markers, camera, lengths: Some(lengths), subspace: None, ..frame };
    // Without limbs nothing but the projection is solved: its derivative is right if a few rounds bring it to the last digits.
    let loose = Options { length_weight: 0.0, prior_weight: 1e-9, relinearize: 5, ..Options::PAPER };
    let found = &lifted(std::slice::from_ref(&frame), &limbs(), loose, BasisMode::Off)[0];
    assert!(found.residual < 1e-5, "{}", found.residual);
    let exact = Options { length_weight: f64::INFINITY, prior_weight: 0.01, relinearize: 60, ..Options::PAPER };
    let found = &lifted(std::slice::from_ref(&frame), &limbs(), exact, BasisMode::Off)[0];
    assert!(found.residual < 0.5 && found.length_error < 1e-12, "{} {}", found.residual, found.length_error);
}

#[test]
fn a_foreshortened_limb_turns_into_depth() {
    let limb = Vector3::new(0.0, 0.5, 0.05);
    let view = Matrix4::identity();
    let camera = Camera::new(view, orthographic(100.0, SIZE, -10.0, 10.0), SIZE.map(|n| n as i64)).unwrap();
    let prior = vec![Vector3::zeros(), limb];
    // Drawn at three fifths of its length: four fifths of it are depth, to the side where the capture has it.
    let short = 0.6 * limb.norm();
    let markers = vec![[320.0, 240.0], [320.0, 240.0 - 100.0 * short]];
    let frame = Frame { markers, prior, lengths: None, camera, subspace: None };
    let options = Options { prior_weight: 1e-9, depth_weight: 1.0, length_weight: f64::INFINITY, relinearize: 20, ..Options::PAPER };
    let found = &lifted(std::slice::from_ref(&frame), &[[0, 1]], options, BasisMode::Off)[0].markers;
    let d = found[1] - found[0];
    assert!((d.y - short).abs() < 1e-6 && (d.z - 0.8 * limb.norm()).abs() < 1e-6, "{d:?}");
    let stretched = Options { stretch: 1.0, ..options };
    let found = &lifted(&[frame], &[[0, 1]], stretched, BasisMode::Off)[0].markers;
    assert!((found[1] - found[0]).norm() < 0.7 * limb.norm(), "a limb that stretches is as long as it is drawn");
}

#[test]
fn figures_stand_and_look_somewhere() {
    let pose = [Vector3::new(3.0, 1.0, 2.0), Vector3::new(3.0, 1.0, 1.9), Vector3::new(3.0, 1.0, 2.1), Vector3::new(3.0, 1.0, 2.0)];
    // Left is towards −z: the figure looks along +x... turned, along +z.
    let stand = Stand::new(Framing::Heading, &pose, 0, [1, 2]).unwrap();
    assert!((stand.local(Vector3::new(3.0, 1.0, 1.0)) - Vector3::x()).norm() < 1e-15);
    assert!((stand.local(Vector3::new(4.0, 1.0, 2.0)) - Vector3::z()).norm() < 1e-15);
    let p = Vector3::new(0.3, -2.0, 0.7);
    assert!((stand.world(stand.local(p)) - p).norm() < 1e-15 && (stand.outward(stand.inward(p)) - p).norm() < 1e-15);
    assert_eq!(Stand::new(Framing::World, &pose, 0, [1, 2]).unwrap().local(p), p);
    assert_eq!(Stand::new(Framing::Heading, &pose, 0, [3, 3]).unwrap().local(p), p - pose[0]);
    assert_eq!(Stand::new(Framing::Root, &[Vector3::repeat(f64::NAN)], 0, [0, 0]), None);
}

#[test]
fn a_space_about_the_figure_moves_with_it() {
    let mut frame = scene();
    let stand = Stand::new(Framing::Root, &frame.prior, 0, [1, 2]).unwrap();
    let mean: Vec<f64> = frame.prior.iter().flat_map(|p| <[f64; 3]>::from(stand.local(*p))).collect();
    frame.subspace = Some(Subspace::placed(&mean, &[], Framing::Root, &stand));
    frame.lengths = None;
    let to = Vector3::new(0.3, 0.1, -0.2);
    let moved: Pose = frame.prior.iter().map(|p| p + to).collect();
    frame.markers = drawn(&frame.camera, &moved, &mut Rng(1), 0.0);
    let options = Options { prior_weight: 1e-12, ..Options::PAPER };
    let found = &lifted(std::slice::from_ref(&frame), &limbs(), options, BasisMode::Hard)[0].markers;
    let [x, y, _] = frame.camera.project(found[5].into());
    assert!((x - frame.markers[5][0]).abs() < 1e-6 && (y - frame.markers[5][1]).abs() < 1e-6);
    let rigid = found.iter().zip(&frame.prior).map(|(a, b)| ((a - b) - (found[0] - frame.prior[0])).norm()).fold(0.0, f64::max);
    assert!(rigid < 1e-9, "{rigid}");
}

#[test]
fn what_cannot_be_lifted_is_refused() {
    let tree = Tree::new(N, &limbs()).unwrap();
    let run = |change: &dyn Fn(&mut Frame, &mut Options)| {
        let (mut frame, mut options) = (scene(), Options::PAPER);
        change(&mut frame, &mut options);
        Lift { tree: &tree, options, basis_mode: BasisMode::Hard }.run(&[scene(), frame]).unwrap_err()
    };
    assert_eq!(run(&|f, _| f.markers.truncate(3)), (1, LiftError::Count { what: "drawn markers", expected: 24, found: 3 }));
    assert!(matches!(run(&|f, _| f.prior[4].y = f64::NAN), (1, LiftError::Prior { marker: 4, .. })));
    assert_eq!(run(&|f, _| f.lengths = Some(vec![-1.0; 23])), (1, LiftError::Length { limb: 0, found: -1.0 }));
    assert_eq!(run(&|_, o| o.length_weight = f64::INFINITY), (0, LiftError::Overdetermined));
    let nothing = |f: &mut Frame, o: &mut Options| {
        (f.subspace, o.prior_weight) = (None, 0.0);
        f.markers.fill([f64::NAN; 2]);
    };
    assert_eq!(run(&nothing), (0, LiftError::Undetermined));
    assert_eq!(Tree::new(3, &[[0, 3]]), None);
    assert_eq!(Tree::new(3, &[[1, 1]]), None);
}

#[test]
fn limbs_of_no_length_do_no_harm() {
    let mut frame = scene();
    frame.prior[9] = frame.prior[PARENTS[9]];
    frame.lengths = None;
    for options in [Options::PAPER, Options { length_weight: f64::INFINITY, relinearize: 4, rows: LimbRows::Scaled, ..Options::PAPER }] {
        let found = &lifted(std::slice::from_ref(&frame), &limbs(), options, BasisMode::Off)[0];
        assert!(found.markers.iter().all(|p| p.iter().all(|v| v.is_finite())));
        assert!(found.length_error < if options.length_weight.is_finite() { 1.0 } else { 1e-12 }, "{}", found.length_error);
    }
}
