//! Numbers of MoveIt's messages.

/// `CollisionObject.operation`: the object is as it is described.
pub(super) const ADD: i32 = 0;
/// `CollisionObject.operation`: it is gone.
pub(super) const REMOVE: i32 = 1;
/// `CollisionObject.operation`: its shapes are added to those it has.
pub(super) const APPEND: i32 = 2;
/// `CollisionObject.operation`: it is elsewhere.
pub(super) const MOVE: i32 = 3;

/// `SolidPrimitive.type`
pub(super) const BOX: i32 = 1;
/// `SolidPrimitive.type`
pub(super) const SPHERE: i32 = 2;
/// `SolidPrimitive.type`
pub(super) const CYLINDER: i32 = 3;
/// `SolidPrimitive.type`
pub(super) const CONE: i32 = 4;
