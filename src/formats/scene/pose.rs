//! Poses: a position and an orientation in a frame, and the ways in which formats spell orientations.

/// A position in metres and a rotation as a unit quaternion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// x, y, z.
    pub translation: [f64; 3],
    /// x, y, z, w.
    pub rotation: [f64; 4],
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The pose of a frame in itself.
    pub const IDENTITY: Self = Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// The pose with this translation and rotation, which is normalised; `None` where
    /// the rotation has no direction or a number is not finite.
    #[must_use]
    pub fn new(translation: [f64; 3], rotation: [f64; 4]) -> Option<Self> {
        let length = norm(&rotation);
        let is_finite = translation.iter().all(|part| part.is_finite()) && length.is_finite();
        (is_finite && length > 1e-9).then(|| Self { translation, rotation: unit(rotation) })
    }

    /// A rotation about the origin.
    #[must_use]
    pub fn turned(rotation: [f64; 4]) -> Self {
        Self { rotation: unit(rotation), ..Self::IDENTITY }
    }

    /// The pose in the outer frame of what is at `inner` in this pose's frame.
    #[must_use]
    pub fn around(&self, inner: &Self) -> Self {
        Self {
            translation: add(self.translation, self.rotate(inner.translation)),
            rotation: unit(multiply(self.rotation, inner.rotation)),
        }
    }

    /// The inverse: the pose of the outer frame in this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation;
        let rotation = [-x, -y, -z, w];
        Self { translation: rotate(rotation, self.translation).map(|part| -part), rotation }
    }

    /// A vector of this pose's frame, in the outer frame.
    #[must_use]
    pub fn rotate(&self, vector: [f64; 3]) -> [f64; 3] {
        rotate(self.rotation, vector)
    }

    /// A point of this pose's frame, in the outer frame.
    #[must_use]
    pub fn place(&self, point: [f64; 3]) -> [f64; 3] {
        add(self.translation, self.rotate(point))
    }

    /// Whether two poses differ by at most `tolerance` metres and radians. A quaternion and
    /// its negative are one rotation.
    #[must_use]
    pub fn is_near(&self, other: &Self, tolerance: f64) -> bool {
        let apart = sub(self.translation, other.translation);
        let [x, y, z, w] = multiply(self.inverse().rotation, other.rotation);
        let angle = 2.0 * norm(&[x, y, z]).atan2(w.abs());
        norm(&apart) <= tolerance && angle <= tolerance
    }

    /// Roll, pitch and yaw in radians: rotations about the fixed axes x, y and z, in this order.
    ///
    /// Roll is what remains once pitch and yaw are undone, so that the three together are exact
    /// where pitch is a right angle, too.
    #[must_use]
    pub fn rpy(&self) -> [f64; 3] {
        let [[r00, r01, r02], [r10, r11, r12], [r20, ..]] = self.matrix();
        let yaw = if r00.hypot(r10) > 1e-12 { r10.atan2(r00) } else { 0.0 };
        let pitch = (-r20).atan2(r00 * yaw.cos() + r10 * yaw.sin());
        let (sin, cos) = yaw.sin_cos();
        let roll = (sin * r02 - cos * r12).atan2(cos * r11 - sin * r01);
        [roll, pitch, yaw]
    }

    /// The rotation as a matrix, row by row.
    #[must_use]
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        let [x, y, z, w] = self.rotation;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }
}

/// The quaternion (x, y, z, w) of roll, pitch and yaw in radians, as [`Pose::rpy`] gives them.
#[must_use]
pub fn from_rpy([roll, pitch, yaw]: [f64; 3]) -> [f64; 4] {
    let about_x = from_axis([1.0, 0.0, 0.0], roll);
    let about_y = from_axis([0.0, 1.0, 0.0], pitch);
    let about_z = from_axis([0.0, 0.0, 1.0], yaw);
    multiply(about_z, multiply(about_y, about_x))
}

/// The quaternion (x, y, z, w) of a turn about an axis, which need not be of length 1.
#[must_use]
pub fn from_axis(axis: [f64; 3], angle: f64) -> [f64; 4] {
    let length = norm(&axis);
    if length == 0.0 {
        return Pose::IDENTITY.rotation;
    }
    let (sin, cos) = (angle / 2.0).sin_cos();
    let [x, y, z] = axis.map(|part| part / length * sin);
    [x, y, z, cos]
}

/// The quaternion (x, y, z, w) of a rotation matrix, given row by row.
#[must_use]
pub fn from_matrix([[a, b, c], [d, e, f], [g, h, i]]: [[f64; 3]; 3]) -> [f64; 4] {
    // The largest of the four squares is taken, so that nothing is divided by a small number.
    let squares = [1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i];
    let rows = [
        [squares[0], b + d, c + g, h - f],
        [b + d, squares[1], f + h, c - g],
        [c + g, f + h, squares[2], d - b],
        [h - f, c - g, d - b, squares[3]],
    ];
    let largest = (0..4).max_by(|one, other| squares[*one].total_cmp(&squares[*other])).unwrap_or(3);
    unit(rows[largest])
}

/// A quaternion that turns the z axis to a direction, which need not be of length 1.
#[must_use]
pub fn from_z_to(direction: [f64; 3]) -> [f64; 4] {
    let length = norm(&direction);
    let [x, y, z] = direction.map(|part| part / length);
    if z < -0.999_999 {
        // Half a turn about x, and the small rest.
        let rest = from_z_to([x, -y, -z]);
        return multiply([1.0, 0.0, 0.0, 0.0], rest);
    }
    unit([-y, x, 0.0, 1.0 + z])
}

/// The product of two quaternions: the rotation `b`, then `a`.
#[must_use]
pub fn multiply([ax, ay, az, aw]: [f64; 4], [bx, by, bz, bw]: [f64; 4]) -> [f64; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// The sum of two vectors.
#[must_use]
pub fn add([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ax + bx, ay + by, az + bz]
}

/// The difference of two vectors.
#[must_use]
pub fn sub([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ax - bx, ay - by, az - bz]
}

/// The scalar product of two vectors.
#[must_use]
pub fn dot([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> f64 {
    ax * bx + ay * by + az * bz
}

/// The vector product.
#[must_use]
pub fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// The Euclidean length.
#[must_use]
pub fn norm(parts: &[f64]) -> f64 {
    parts.iter().map(|part| part * part).sum::<f64>().sqrt()
}

fn unit(rotation: [f64; 4]) -> [f64; 4] {
    let length = norm(&rotation);
    // A unit quaternion stays as it is, digit by digit.
    if (length - 1.0).abs() < 1e-15 { rotation } else { rotation.map(|part| part / length) }
}

/// `v + 2 q × (q × v + w v)`, for a unit quaternion.
fn rotate([x, y, z, w]: [f64; 4], [vx, vy, vz]: [f64; 3]) -> [f64; 3] {
    let (tx, ty, tz) = (y * vz - z * vy + w * vx, z * vx - x * vz + w * vy, x * vy - y * vx + w * vz);
    [vx + 2.0 * (y * tz - z * ty), vy + 2.0 * (z * tx - x * tz), vz + 2.0 * (x * ty - y * tx)]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

    /// Poses, a quarter of them turned by right angles, where conversions break first.
    pub(crate) fn poses() -> impl Strategy<Value = Pose> {
        let any = prop::array::uniform4(-1.0..1.0_f64).prop_filter("no rotation", |parts| norm(parts) > 0.1);
        let right =
            prop::array::uniform3(-2..=2_i8).prop_map(|turns| from_rpy(turns.map(|turn| f64::from(turn) * FRAC_PI_2)));
        let rotation = prop_oneof![3 => any, 1 => right];
        (prop::array::uniform3(-100.0..100.0_f64), rotation)
            .prop_map(|(translation, rotation)| Pose { translation, rotation: unit(rotation) })
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let turn = Pose { translation: [1.0, 2.0, 3.0], rotation: [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2] };
        let moved = turn.around(&Pose { translation: [1.0, 0.0, 0.0], ..Pose::IDENTITY });
        assert!(moved.is_near(&Pose { translation: [1.0, 3.0, 3.0], rotation: turn.rotation }, 1e-12), "{moved:?}");
        assert!((turn.rpy()[2] - FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn a_rotation_of_no_length_is_no_pose() {
        assert_eq!(Pose::new([0.0; 3], [0.0; 4]), None);
        assert_eq!(Pose::new([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), None);
        assert_eq!(Pose::new([0.0; 3], [0.0, 0.0, 0.0, 2.0]), Some(Pose::IDENTITY));
    }

    proptest! {
        #[test]
        fn there_and_back_is_where_it_was(a in poses(), b in poses()) {
            prop_assert!(a.inverse().around(&a.around(&b)).is_near(&b, 1e-9));
            prop_assert!(a.around(&a.inverse()).is_near(&Pose::IDENTITY, 1e-9));
        }

        #[test]
        fn it_does_not_matter_what_is_put_together_first(a in poses(), b in poses(), c in poses()) {
            prop_assert!(a.around(&b).around(&c).is_near(&a.around(&b.around(&c)), 1e-9));
        }

        #[test]
        fn every_spelling_of_a_rotation_reads_back(pose in poses()) {
            prop_assert!(Pose::turned(from_rpy(pose.rpy())).is_near(&Pose::turned(pose.rotation), 1e-12));
            prop_assert!(Pose::turned(from_matrix(pose.matrix())).is_near(&Pose::turned(pose.rotation), 1e-12));
            let up = pose.rotate([0.0, 0.0, 1.0]);
            let again = Pose::turned(from_z_to(up)).rotate([0.0, 0.0, 1.0]);
            prop_assert!(norm(&sub(up, again)) < 1e-12);
        }

        #[test]
        fn near_right_angles_roll_pitch_and_yaw_are_exact(tilt in -1e-7..1e-7_f64, roll in -3.0..3.0_f64, yaw in -3.0..3.0_f64) {
            let pose = Pose::turned(from_rpy([roll, FRAC_PI_2 + tilt, yaw]));
            prop_assert!(Pose::turned(from_rpy(pose.rpy())).is_near(&pose, 1e-12));
        }
    }
}
