//! The tiles around a sensor under one BVH.

use std::cell::Cell;
use std::sync::Arc;

use nalgebra::Vector3;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::ground::Ground;
use super::shape::{Ray, Shape};
use super::tile::{Hit, TileScene};
use crate::world::{Class, Object};

/// Tiles that rays are cast at together. Rays are told about `origin`, a point of the world near the sensor.
pub struct Scene {
    origin: Vector3<f64>,
    tiles: Vec<(Arc<TileScene>, Vector)>,
    bvh: Bvh,
}

impl Scene {
    /// The scene of some tiles; empty ones are left out.
    pub fn new(origin: Vector3<f64>, tiles: impl IntoIterator<Item = Arc<TileScene>>) -> Self {
        let tiles: Vec<_> =
            tiles.into_iter().filter(|t| !t.is_empty()).map(|t| (t.clone(), t.offset(origin))).collect();
        let boxes: Vec<Aabb> = tiles.iter().map(|(t, _)| t.bounds_about(origin)).collect();
        Self { origin, bvh: Bvh::from_leaves(BvhBuildStrategy::Ploc, &boxes), tiles }
    }

    /// A scene of loose shapes, each an object of its own, numbered from 1.
    ///
    /// ```
    /// use esm_sim::{Key, Ray, Scene, Shape};
    /// use nalgebra::Vector3;
    /// let ball = Shape::spheroid(Vector3::x() * 5.0, Vector3::z(), 1.0, 1.0);
    /// let scene = Scene::of_shapes(&[ball]);
    /// let ray = Ray::try_new(Vector3::zeros(), Vector3::x(), Key::new(1)).ok_or("no direction")?;
    /// assert_eq!(scene.cast(&ray, 100.0).map(|hit| (hit.distance, hit.object_id)), Some((4.0, 1)));
    /// # Ok::<(), &str>(())
    /// ```
    pub fn of_shapes(shapes: &[Shape]) -> Self {
        let object = |(n, shape): (usize, &Shape)| Object {
            id: n as u32 + 1,
            class: Class::Rock,
            anchor: Vector3::zeros(),
            shapes: vec![*shape],
        };
        let objects: Vec<Object> = shapes.iter().enumerate().map(object).collect();
        Self::new(
            Vector3::zeros(),
            [Arc::new(TileScene::build(Vector3::zeros(), &objects, Ground::default()))],
        )
    }

    /// The point of the world that rays are told about.
    pub fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// Number of shapes and terrain cells.
    pub fn leaves(&self) -> usize {
        self.tiles.iter().map(|(t, _)| t.leaves()).sum()
    }

    /// The first thing a ray meets within `limit` metres.
    pub fn cast(&self, ray: &Ray, limit: f32) -> Option<Hit> {
        // parry's query keeps distance and tile; the leaf inside the tile is kept beside it.
        let found: Cell<Option<u32>> = Cell::new(None);
        let (tile, distance) = self.bvh.cast_ray(&ray.to_query(), limit, |tile, best| {
            let (scene, offset) = &self.tiles[tile as usize];
            let (leaf, distance) = scene.cast(&ray.moved(*offset), best)?;
            found.set(Some(leaf));
            Some(distance)
        })?;
        let (scene, offset) = &self.tiles[tile as usize];
        Some(scene.describe(&ray.moved(*offset), found.get()?, distance))
    }

    /// The same by looking at every shape of every tile: slow, and right where [`cast`](Self::cast) is.
    pub fn cast_brute_force(&self, ray: &Ray, limit: f32) -> Option<Hit> {
        let (scene, offset, leaf, distance) = self
            .tiles
            .iter()
            .filter_map(|(scene, offset)| {
                let (leaf, distance) = scene.cast_brute_force(&ray.moved(*offset), limit)?;
                Some((scene, *offset, leaf, distance))
            })
            .min_by(|a, b| a.3.total_cmp(&b.3))?;
        Some(scene.describe(&ray.moved(offset), leaf, distance))
    }
}
