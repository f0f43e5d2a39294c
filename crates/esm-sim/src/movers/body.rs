//! The shapes of movers about their own frame: x ahead, z up, the origin on the ground.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::cast::{Ground, Scene, Shape, TileScene};
use crate::hash::Draw;
use crate::world::{Class, Object, striding, vehicle};

type V = Vector3<f32>;

/// Parts that a stride or a turn of the pedals is cut into.
const PHASES: usize = 8;

/// A mover's surface and the ball around it.
pub(super) struct Body {
    scene: Scene,
    /// Middle of the ball.
    pub(super) middle: V,
    /// Its radius, metres.
    pub(super) radius: f32,
}

impl Body {
    fn new(id: u32, class: Class, shapes: Vec<Shape>) -> Self {
        let object = Object { id, class, anchor: Vector3::zeros(), shapes };
        let tile = TileScene::build(Vector3::zeros(), &[object], Ground::default());
        let (low, high) = tile.extent();
        Self {
            scene: Scene::new(Vector3::zeros(), [Arc::new(tile)]),
            middle: 0.5 * (low + high),
            radius: 0.5 * (high - low).norm(),
        }
    }

    pub(super) fn scene(&self) -> &Scene {
        &self.scene
    }
}

/// A car or van.
pub(super) fn car(id: u32, class: Class, draw: &mut Draw) -> Vec<Body> {
    vec![Body::new(id, class, vehicle(class == Class::MovingVan, 0.0, draw))]
}

/// One body for each part of a stride; `of` makes the shapes from the swing of the legs, -1 to 1.
fn gait(id: u32, class: Class, of: impl Fn(f32) -> Vec<Shape>) -> Vec<Body> {
    let swing = |n: usize| (std::f32::consts::TAU * (n as f32 + 0.5) / PHASES as f32).sin();
    (0..PHASES).map(|n| Body::new(id, class, of(swing(n)))).collect()
}

/// Somebody on foot, with the length of the stride (two steps), metres.
pub(super) fn walker(id: u32, draw: &mut Draw) -> (Vec<Body>, f64) {
    let scale = draw.range(0.86, 1.08);
    let bodies = gait(id, Class::Walker, |swing| striding(0.0, scale, 0.33 * swing));
    (bodies, 1.45 * f64::from(scale))
}

/// A dog, nose ahead, with the length of its stride.
pub(super) fn dog(id: u32, draw: &mut Draw) -> (Vec<Body>, f64) {
    let k = draw.range(0.6, 1.25);
    let bodies = gait(id, Class::Dog, |swing| {
        let p = |x: f32, y: f32, z: f32| V::new(x, y, z) * k;
        let mut shapes = vec![
            Shape::spheroid(p(0.0, 0.0, 0.48), V::x(), 0.36 * k, 0.13 * k),
            Shape::spheroid(p(0.42, 0.0, 0.66), V::new(1.0, 0.0, -0.3), 0.14 * k, 0.08 * k),
            Shape::frustum(p(0.25, 0.0, 0.55), p(0.38, 0.0, 0.64), 0.08 * k, 0.06 * k),
            Shape::frustum(p(-0.34, 0.0, 0.52), p(-0.58, 0.03 * swing, 0.68), 0.03 * k, 0.015 * k),
        ];
        for (x, y) in [(0.22, 0.08), (0.22, -0.08), (-0.24, 0.08), (-0.24, -0.08)] {
            // Legs across from each other swing together.
            let step = 0.16 * swing * if x * y > 0.0 { 1.0 } else { -1.0 };
            shapes.push(Shape::frustum(p(x + step, y, 0.0), p(x, y, 0.42), 0.025 * k, 0.045 * k));
        }
        shapes
    });
    (bodies, 1.1 * f64::from(k))
}

/// Somebody on a bicycle, with the metres a turn of the pedals drives.
pub(super) fn cyclist(id: u32, draw: &mut Draw) -> (Vec<Body>, f64) {
    let k = draw.range(0.92, 1.06);
    let lean = draw.range(0.15, 0.6);
    let bodies = gait(id, Class::Cyclist, |swing| {
        let p = |x: f32, y: f32, z: f32| V::new(x, y, z) * k;
        let (hip, crank) = (p(-0.2, 0.0, 0.98), p(-0.05, 0.0, 0.3));
        let shoulder = hip + p(0.58 * lean.sin(), 0.0, 0.58 * lean.cos());
        let bar = p(0.42, 0.0, 1.02);
        let mut shapes = vec![
            Shape::frustum(p(-0.52, -0.02, 0.34), p(-0.52, 0.02, 0.34), 0.34 * k, 0.34 * k),
            Shape::frustum(p(0.52, -0.02, 0.34), p(0.52, 0.02, 0.34), 0.34 * k, 0.34 * k),
            Shape::frustum(crank, p(0.4, 0.0, 0.8), 0.025, 0.025),
            Shape::frustum(crank, hip - p(0.0, 0.0, 0.08), 0.022, 0.022),
            Shape::frustum(p(0.52, 0.0, 0.34), bar, 0.02, 0.02),
            Shape::frustum(p(0.42, -0.28, 1.02), p(0.42, 0.28, 1.02), 0.018, 0.018),
            Shape::spheroid(0.5 * (hip + shoulder), shoulder - hip, 0.4 * k, 0.19 * k),
            Shape::spheroid(shoulder + p(0.1, 0.0, 0.24), V::z(), 0.15 * k, 0.11 * k),
        ];
        for side in [-1.0, 1.0] {
            let foot = crank + p(0.0, side * 0.1, 0.17 * swing * side);
            let knee = 0.5 * (hip + foot) + p(0.2, side * 0.06, 0.08);
            let at_hip = hip + p(0.0, side * 0.09, 0.0);
            shapes.push(Shape::frustum(foot, knee, 0.05 * k, 0.06 * k));
            shapes.push(Shape::frustum(knee, at_hip, 0.065 * k, 0.085 * k));
            let (arm, hand) = (shoulder + p(0.0, side * 0.19, 0.0), bar + p(0.0, side * 0.24, 0.0));
            shapes.push(Shape::frustum(arm, hand, 0.05 * k, 0.035 * k));
        }
        shapes
    });
    (bodies, 4.5)
}
