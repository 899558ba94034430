//! Projections against NumPy, closed forms, and cameras that are none.

use super::*;

const SIZE: [usize; 2] = [1280, 720];

fn orbit() -> Orbit {
    let [azimuth, elevation] = [35.0_f64, -20.0].map(f64::to_radians);
    Orbit { target: [0.3, 1.1, -0.4], azimuth, elevation, roll: 0.0, distance: 4.5 }
}

fn camera(projection: Matrix4<f64>) -> Camera {
    Camera::new(orbit().view(), projection, [1280, 720]).unwrap()
}

fn assert_near(found: [f64; 3], truth: [f64; 3]) {
    for k in 0..3 {
        assert!((found[k] - truth[k]).abs() < 1e-9, "expected {truth:?}, found {found:?}");
    }
}

/// World points, and where a look-at matrix in NumPy (eye, cross products, inverse) puts them: perspective, then orthographic.
const TRUTH: [([f64; 3], [f64; 3], [f64; 3]); 4] = [
    (
        [0.0, 0.0, 0.0],
        [513.3055054499499, 621.4131934465097, 3.9775730532224682],
        [568.7235718259326, 507.0671537276863, 3.9775730532224682],
    ),
    ([0.3, 1.1, -0.4], [640.0, 360.0, 4.5], [640.0, 360.0, 4.5]),
    ([1.0, 2.0, 0.5], [656.2260530428878, 9.5335667313133, 3.737752229518021], [648.5781457429529, 174.7206757770694, 3.737752229518021]),
    (
        [-1.5, 0.2, 1.0],
        [48.689864215049994, 569.4215519331019, 4.084704267611179],
        [298.3778964082526, 480.9907065331512, 4.084704267611179],
    ),
];

#[test]
fn points_project_as_in_numpy() {
    let [lens, flat] = [camera(perspective(37.5_f64.to_radians(), SIZE, 0.2, 60.0)), camera(orthographic(150.0, SIZE, 0.2, 60.0))];
    assert!(flat.is_orthographic() && !lens.is_orthographic());
    for (world, in_lens, in_flat) in TRUTH {
        assert_near(lens.project(world), in_lens);
        assert_near(flat.project(world), in_flat);
    }
}

#[test]
fn depth_follows_from_clip_space() {
    for camera in [camera(perspective(0.7, SIZE, 0.2, 60.0)), camera(orthographic(150.0, SIZE, -5.0, 60.0))] {
        let [a, b] = camera.depth_of_clip();
        for (world, _, _) in TRUTH {
            let clip = camera.clip_from_world() * Vector4::new(world[0], world[1], world[2], 1.0);
            let along = if camera.is_orthographic() { clip.z } else { clip.w };
            assert!((a * along + b - camera.project(world)[2]).abs() < 1e-12);
        }
    }
}

#[test]
fn azimuth_goes_round_to_x_and_elevation_up() {
    let eye = |azimuth: f64, elevation: f64| {
        let orbit = Orbit { target: [0.0; 3], azimuth: azimuth.to_radians(), elevation: elevation.to_radians(), roll: 0.0, distance: 2.0 };
        let world = orbit.view().try_inverse().unwrap();
        world.column(3).xyz()
    };
    assert!((eye(0.0, 0.0) - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-12);
    assert!((eye(90.0, 0.0) - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-12);
    assert!((eye(0.0, 90.0) - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-12);
}

#[test]
fn roll_turns_the_picture_the_other_way() {
    let rolled = Orbit { roll: std::f64::consts::FRAC_PI_2, azimuth: 0.0, elevation: 0.0, target: [0.0; 3], distance: 2.0 };
    let camera = Camera::new(rolled.view(), orthographic(100.0, SIZE, 0.1, 10.0), [1280, 720]).unwrap();
    // A camera that is turned anticlockwise sees what is above it at its right.
    assert_near(camera.project([0.0, 1.0, 0.0]), [740.0, 360.0, 2.0]);
}

#[test]
fn an_orthographic_metre_has_as_many_pixels_as_the_scale_says() {
    let flat = camera(orthographic(150.0, SIZE, 0.2, 60.0));
    let up = [0.3 + 0.0, 1.1 + 1.0, -0.4];
    // Seen from 20 degrees below, a metre upwards is foreshortened by the cosine.
    assert_near(flat.project(up), [640.0, 360.0 - 150.0 * 20.0_f64.to_radians().cos(), 4.5 + 20.0_f64.to_radians().sin()]);
}

#[test]
fn toward_points_at_the_eye_or_back_along_the_axis() {
    let lens = camera(perspective(0.7, SIZE, 0.2, 60.0));
    let flat = camera(orthographic(150.0, SIZE, 0.2, 60.0));
    let target = Vector3::from(orbit().target);
    assert!((lens.toward()(&target).norm() - 4.5).abs() < 1e-12);
    assert!((lens.toward()(&target).normalize() - flat.toward()(&(target * 7.0))).norm() < 1e-12);
}

#[test]
fn what_is_no_camera_is_refused() {
    let eye = Matrix4::identity();
    let lens = perspective(0.7, SIZE, 0.2, 60.0);
    let text = |view, projection, size| Camera::new(view, projection, size).unwrap_err().to_string();
    assert_eq!(text(eye * f64::NAN, lens, [4, 4]), "expected finite view, found NaN");
    assert_eq!(text(eye, Matrix4::zeros(), [4, 4]), "expected a projection whose last row is (0, 0, p, q), found (0, 0, 0, 0)");
    assert!(text(Matrix4::zeros(), lens, [4, 4]).starts_with("expected a view of rotation and translation"));
    assert_eq!(text(eye, lens, [0, 4]), "expected a picture of 1 to 65536 pixels a side, found 0 x 4");
}
