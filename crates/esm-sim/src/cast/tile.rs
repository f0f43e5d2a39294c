//! One tile of a world: its objects' shapes in a BVH, and its terrain.

use nalgebra::Vector3;
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::ground::Ground;
use super::shape::{Ray, Shape, from_parry, to_parry};
use crate::world::{Class, Object};

/// Where a ray ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Metres along the ray.
    pub distance: f32,
    /// The object's number, 0 for the ground.
    pub object_id: u32,
    /// Its class.
    pub class: Class,
    /// Cosine of the angle between the ray and the surface's normal, 0 to 1; 1 in foliage.
    pub cos_incidence: f32,
    /// Whether foliage was hit.
    pub in_medium: bool,
}

/// A tile that rays can be cast at. Its coordinates are relative to `origin`, so f32 holds everywhere in the world.
pub struct TileScene {
    /// In world coordinates.
    pub(super) origin: Vector3<f64>,
    bvh: Bvh,
    shapes: Vec<Shape>,
    owners: Vec<u32>,
    objects: Vec<(u32, Class)>,
    ground: Ground,
    /// Media of different tiles draw apart.
    salt: u32,
}

impl TileScene {
    pub(crate) fn build(origin: Vector3<f64>, objects: &[Object], ground: Ground) -> Self {
        let mut shapes = Vec::new();
        let mut owners = Vec::new();
        for (number, object) in objects.iter().enumerate() {
            let by = (object.anchor - origin).cast::<f32>();
            shapes.extend(object.shapes.iter().map(|s| s.moved(by)));
            owners.resize(shapes.len(), number as u32);
        }
        let boxes: Vec<Aabb> = shapes.iter().map(Shape::aabb).collect();
        // The slower build: its tree answers a tenth faster, and a tile serves many sweeps.
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Ploc, &boxes);
        let objects = objects.iter().map(|o| (o.id, o.class)).collect();
        let cell = |v: f64| (v as i64 as u32).wrapping_mul(0x9E37_79B1);
        let salt = cell(origin.x).rotate_left(16) ^ cell(origin.y);
        Self { salt, origin, bvh, shapes, owners, objects, ground }
    }

    pub(super) fn aabb(&self) -> Aabb {
        match (self.shapes.is_empty(), self.ground.len()) {
            (_, 0) => self.bvh.root_aabb(),
            (true, _) => self.ground.aabb(),
            (false, _) => self.bvh.root_aabb().merged(&self.ground.aabb()),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.leaves() == 0
    }

    /// The nearest leaf a ray (about the tile's origin) hits below `limit`: shapes first, then the cells of the ground.
    #[inline]
    pub(super) fn cast(&self, ray: &Ray, limit: f32) -> Option<(u32, f32)> {
        let ground = self.ground.cast(ray, limit);
        let limit = ground.map_or(limit, |(_, distance)| distance);
        let shape = |leaf: u32, best: f32| self.shapes[leaf as usize].cast(ray, best, self.number(leaf));
        let standing = self.bvh.cast_ray(&ray.to_query(), limit, shape);
        standing.or_else(|| ground.map(|(cell, distance)| ((self.shapes.len() + cell) as u32, distance)))
    }

    /// The same by looking at every leaf.
    pub(super) fn cast_brute_force(&self, ray: &Ray, limit: f32) -> Option<(u32, f32)> {
        let leaf = |leaf: u32| match self.shapes.get(leaf as usize) {
            Some(shape) => shape.cast(ray, limit, self.number(leaf)),
            None => self.ground.cast_cell(ray, leaf as usize - self.shapes.len(), limit),
        };
        (0..self.leaves() as u32).filter_map(|n| Some((n, leaf(n)?))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// What media draw by.
    #[inline]
    fn number(&self, leaf: u32) -> u32 {
        self.salt.wrapping_add(leaf)
    }

    /// What stands at a leaf.
    pub(super) fn describe(&self, ray: &Ray, leaf: u32, distance: f32) -> Hit {
        let at = ray.origin + ray.dir * distance;
        let (object_id, class, normal, in_medium) = match self.shapes.get(leaf as usize) {
            Some(shape) => {
                let (id, class) = self.objects[self.owners[leaf as usize] as usize];
                (id, class, shape.normal(at, ray), shape.is_medium())
            }
            None => {
                let cell = leaf as usize - self.shapes.len();
                (0, self.ground.class(cell), self.ground.normal(cell), false)
            }
        };
        let cos_incidence = normal.dot(ray.dir).abs().min(1.0);
        Hit { distance, object_id, class, cos_incidence, in_medium }
    }

    pub(super) fn offset(&self, from: Vector3<f64>) -> Vector {
        to_parry((from - self.origin).cast::<f32>())
    }

    /// Lowest and highest corner, world coordinates.
    pub(super) fn bounds_about(&self, origin: Vector3<f64>) -> Aabb {
        let by = to_parry((self.origin - origin).cast::<f32>());
        let aabb = self.aabb();
        Aabb::new(aabb.mins + by, aabb.maxs + by)
    }

    /// Number of shapes and terrain cells.
    pub fn leaves(&self) -> usize {
        self.shapes.len() + self.ground.len()
    }

    /// The box around everything, metres about the tile's origin.
    pub fn extent(&self) -> (Vector3<f32>, Vector3<f32>) {
        (from_parry(self.aabb().mins), from_parry(self.aabb().maxs))
    }
}
