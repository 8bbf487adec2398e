//! Poses: where something is and how it is turned, in a frame.

use bson::{Bson, Document};

/// A position in metres and a rotation as a unit quaternion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// x, y, z.
    pub(super) translation: [f64; 3],
    /// x, y, z, w.
    pub(super) rotation: [f64; 4],
}

impl Pose {
    pub(super) const IDENTITY: Self = Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// The pose under `translation` and `rotation` in a document. A quaternion of any
    /// length but 0 is one of rotation.
    pub(super) fn of(document: &Document) -> Result<Self, String> {
        let translation = numbers(document, "translation")?;
        let rotation: [f64; 4] = numbers(document, "rotation")?;
        let length = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
        if !(length > 1e-9 && length.is_finite()) {
            return Err(format!("its `rotation` {rotation:?} is no rotation; expected a unit quaternion [x, y, z, w]"));
        }
        Ok(Self { translation, rotation: rotation.map(|part| part / length) })
    }

    /// What is at `inner` in this pose's frame, in the frame around.
    pub(super) fn around(&self, inner: &Self) -> Self {
        let turned = rotate(self.rotation, inner.translation);
        let [x, y, z] = self.translation;
        Self {
            translation: [x + turned[0], y + turned[1], z + turned[2]],
            rotation: unit(multiply(self.rotation, inner.rotation)),
        }
    }

    /// The way back.
    pub(super) fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation;
        let rotation = [-x, -y, -z, w];
        Self { translation: rotate(rotation, self.translation).map(|part| -part), rotation }
    }
}

/// An array of exactly so many numbers.
pub(super) fn numbers<const N: usize>(document: &Document, key: &str) -> Result<[f64; N], String> {
    let wrong = || format!("its `{key}` is not {N} numbers");
    let values = document.get_array(key).map_err(|_| wrong())?;
    let values: Vec<f64> = values.iter().map(number).collect::<Option<_>>().ok_or_else(wrong)?;
    values.try_into().map_err(|_| wrong())
}

/// A finite number.
pub(super) fn number(value: &Bson) -> Option<f64> {
    let number = match value {
        Bson::Double(number) => *number,
        Bson::Int32(number) => f64::from(*number),
        // What is beyond 2^53 is no position.
        Bson::Int64(number) => *number as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

fn multiply([ax, ay, az, aw]: [f64; 4], [bx, by, bz, bw]: [f64; 4]) -> [f64; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

fn unit(rotation: [f64; 4]) -> [f64; 4] {
    let length = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
    rotation.map(|part| part / length)
}

/// `v + 2 q × (q × v + w v)`, for a unit quaternion.
fn rotate([x, y, z, w]: [f64; 4], [vx, vy, vz]: [f64; 3]) -> [f64; 3] {
    let (tx, ty, tz) = (y * vz - z * vy + w * vx, z * vx - x * vz + w * vy, x * vy - y * vx + w * vz);
    [vx + 2.0 * (y * tz - z * ty), vy + 2.0 * (z * tx - x * tz), vz + 2.0 * (x * ty - y * tx)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;
    use proptest::prelude::*;

    fn close(a: &Pose, b: &Pose) -> bool {
        // A quaternion and its negative are one rotation.
        let dot: f64 = a.rotation.iter().zip(b.rotation).map(|(a, b)| a * b).sum();
        (dot.abs() - 1.0).abs() < 1e-12 && a.translation.iter().zip(b.translation).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    fn poses() -> impl Strategy<Value = Pose> {
        let rotation = prop::array::uniform4(-1.0..1.0_f64)
            .prop_filter("no rotation", |rotation| rotation.iter().map(|part| part * part).sum::<f64>() > 0.01);
        (prop::array::uniform3(-100.0..100.0_f64), rotation)
            .prop_map(|(translation, rotation)| Pose { translation, rotation: unit(rotation) })
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turn = Pose { translation: [1.0, 2.0, 3.0], rotation: [0.0, 0.0, half, half] };
        let moved = turn.around(&Pose { translation: [1.0, 0.0, 0.0], ..Pose::IDENTITY });
        assert!(close(&moved, &Pose { translation: [1.0, 3.0, 3.0], rotation: turn.rotation }), "{moved:?}");
    }

    #[test]
    fn a_pose_needs_numbers_and_a_rotation() {
        let pose =
            |translation: Bson, rotation: Bson| Pose::of(&doc! { "translation": translation, "rotation": rotation });
        let (zero, one) = (Bson::from(vec![0, 0, 0]), Bson::from(vec![0, 0, 0, 2]));
        assert_eq!(pose(zero.clone(), one.clone()), Ok(Pose::IDENTITY));
        for (translation, rotation) in [
            (Bson::from(vec![0, 0]), one.clone()),
            (Bson::from(vec!["0", "0", "0"]), one.clone()),
            (Bson::from(vec![f64::NAN, 0.0, 0.0]), one),
            (zero.clone(), Bson::from(vec![0, 0, 0, 0])),
            (zero, Bson::Null),
        ] {
            assert!(pose(translation, rotation).is_err());
        }
    }

    proptest! {
        #[test]
        fn there_and_back_is_where_it_was(a in poses(), b in poses()) {
            prop_assert!(close(&a.inverse().around(&a.around(&b)), &b));
            prop_assert!(close(&a.around(&a.inverse()), &Pose::IDENTITY));
        }

        #[test]
        fn it_does_not_matter_what_is_put_together_first(a in poses(), b in poses(), c in poses()) {
            prop_assert!(close(&a.around(&b).around(&c), &a.around(&b.around(&c))));
        }
    }
}
