//! Two scenes as the operations that lead from one to the other.

use std::collections::HashMap;

use crate::formats::scene::{Object, Operation, Scene};

/// The operations that make the first scene the second. Numbers that differ by at most `tolerance`
/// are equal.
#[must_use]
pub fn diff(first: &Scene, second: &Scene, tolerance: f64) -> Vec<Operation> {
    let by_name = |scene: &'_ Scene| -> HashMap<String, usize> {
        scene.objects.iter().enumerate().map(|(index, object)| (object.name.clone(), index)).collect()
    };
    let (old, new) = (by_name(first), by_name(second));
    let gone = first.objects.iter().filter(|object| !new.contains_key(&object.name));
    let mut operations: Vec<Operation> = gone.map(|object| Operation::Remove { name: object.name.clone() }).collect();
    for object in &second.objects {
        match old.get(&object.name).and_then(|index| first.objects.get(*index)) {
            None => operations.push(Operation::Add(Box::new(object.clone()))),
            Some(before) => changes(before, object, tolerance, &mut operations),
        }
    }
    operations
}

/// What is different in one object: it is let go before it is moved, and moved before it is taken.
pub fn changes(before: &Object, after: &Object, tolerance: f64, operations: &mut Vec<Operation>) {
    let name = || after.name.clone();
    if is_reshaped(before, after, tolerance) {
        operations.push(Operation::Reshape(Box::new(after.clone())));
    }
    let is_attached_anew = before.attachment != after.attachment;
    if let Some(held) = before.attachment.as_ref().filter(|_| is_attached_anew) {
        operations.push(Operation::Detach { name: name(), link: held.link.clone() });
    }
    if !before.pose.is_near(&after.pose, tolerance) {
        operations.push(Operation::Move { name: name(), pose: after.pose });
    }
    if let Some(attachment) = after.attachment.clone().filter(|_| is_attached_anew) {
        operations.push(Operation::Attach { name: name(), attachment });
    }
}

/// Whether anything but pose and attachment differs.
#[must_use]
pub fn is_reshaped(before: &Object, after: &Object, tolerance: f64) -> bool {
    let as_before = Object { pose: before.pose, attachment: before.attachment.clone(), ..after.clone() };
    !before.is_near(&as_before, tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::scene::{Attachment, Pose, Shape, Solid};

    fn cup(x: f64) -> Object {
        let pose = Pose { translation: [x, 0.0, 0.0], ..Pose::IDENTITY };
        Object {
            name: "cup".into(),
            pose,
            shapes: vec![Shape::new(Solid::Sphere(0.1), Pose::IDENTITY)],
            ..Object::default()
        }
    }

    fn words(first: &[Object], second: &[Object]) -> Vec<&'static str> {
        let scene = |objects: &[Object]| Scene { objects: objects.to_vec(), ..Scene::default() };
        diff(&scene(first), &scene(second), 1e-9).iter().map(Operation::word).collect()
    }

    #[test]
    fn each_difference_is_an_operation() {
        let held = Object { attachment: Some(Attachment { link: "hand".into(), touch: vec![] }), ..cup(1.0) };
        let heavy = Object { mass: Some(1.0), ..cup(0.0) };
        let none: [&str; 0] = [];
        assert_eq!(words(&[cup(0.0)], &[cup(1e-10)]), none);
        assert_eq!(words(&[], &[cup(0.0)]), ["add"]);
        assert_eq!(words(&[cup(0.0)], &[]), ["remove"]);
        assert_eq!(words(&[cup(0.0)], &[cup(1.0)]), ["move"]);
        assert_eq!(words(&[cup(0.0)], &[heavy]), ["reshape"]);
        assert_eq!(words(&[cup(0.0)], std::slice::from_ref(&held)), ["move", "attach"]);
        assert_eq!(words(&[held], &[cup(0.0)]), ["detach", "move"]);
    }
}
