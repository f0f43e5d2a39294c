//! One tile of a world: its objects' shapes and its terrain in one BVH.

use nalgebra::Vector3;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

use super::shape::{Ray, Shape, from_parry, to_parry, triangle};
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

/// A square of terrain heights, metres about the tile's origin.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeightGrid {
    /// Cells a side.
    pub(crate) cells: usize,
    /// Metres a cell.
    pub(crate) size: f32,
    /// `(cells + 1)^2` heights, rows along y.
    pub(crate) heights: Vec<f32>,
    /// Class of each cell.
    pub(crate) classes: Vec<Class>,
}

/// A tile that rays can be cast at. Its coordinates are relative to `origin`, so f32 holds everywhere in the world.
pub struct TileScene {
    /// In world coordinates.
    pub(super) origin: Vector3<f64>,
    bvh: Bvh,
    shapes: Vec<Shape>,
    owners: Vec<u32>,
    objects: Vec<(u32, Class)>,
    ground: HeightGrid,
    /// Media of different tiles draw apart.
    salt: u32,
}

impl TileScene {
    pub(crate) fn build(origin: Vector3<f64>, objects: &[Object], ground: HeightGrid) -> Self {
        let mut shapes = Vec::new();
        let mut owners = Vec::new();
        for (number, object) in objects.iter().enumerate() {
            let by = (object.anchor - origin).cast::<f32>();
            shapes.extend(object.shapes.iter().map(|s| s.moved(by)));
            owners.resize(shapes.len(), number as u32);
        }
        let mut boxes: Vec<Aabb> = shapes.iter().map(Shape::aabb).collect();
        for cell in 0..ground.cells * ground.cells {
            let [a, b, c, d] = corners(&ground, cell);
            boxes.push(Aabb::new(a.min(b).min(c).min(d), a.max(b).max(c).max(d)));
        }
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let objects = objects.iter().map(|o| (o.id, o.class)).collect();
        let cell = |v: f64| (v as i64 as u32).wrapping_mul(0x9E37_79B1);
        let salt = cell(origin.x).rotate_left(16) ^ cell(origin.y);
        Self { salt, origin, bvh, shapes, owners, objects, ground }
    }

    pub(super) fn aabb(&self) -> Aabb {
        self.bvh.root_aabb()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.bvh.is_empty()
    }

    /// The nearest leaf a ray (about the tile's origin) hits below `limit`.
    #[inline]
    pub(super) fn cast(&self, ray: &Ray, limit: f32) -> Option<(u32, f32)> {
        self.bvh.cast_ray(&ray.to_query(), limit, |leaf, best| self.cast_leaf(ray, leaf, best))
    }

    /// The same by looking at every leaf.
    pub(super) fn cast_brute_force(&self, ray: &Ray, limit: f32) -> Option<(u32, f32)> {
        let leaves = (self.shapes.len() + self.ground.cells * self.ground.cells) as u32;
        (0..leaves)
            .filter_map(|leaf| Some((leaf, self.cast_leaf(ray, leaf, limit)?)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    #[inline]
    fn cast_leaf(&self, ray: &Ray, leaf: u32, limit: f32) -> Option<f32> {
        match self.shapes.get(leaf as usize) {
            Some(shape) => shape.cast(ray, limit, self.salt.wrapping_add(leaf)),
            None => {
                let [a, b, c, d] = corners(&self.ground, leaf as usize - self.shapes.len());
                triangle(ray, a, b, c).or_else(|| triangle(ray, b, d, c)).filter(|t| *t < limit)
            }
        }
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
                let [a, b, c, _] = corners(&self.ground, cell);
                (0, self.ground.classes[cell], (b - a).cross(c - a).normalize_or_zero(), false)
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
        self.shapes.len() + self.ground.cells * self.ground.cells
    }

    /// The box around everything, metres about the tile's origin.
    pub fn extent(&self) -> (Vector3<f32>, Vector3<f32>) {
        (from_parry(self.aabb().mins), from_parry(self.aabb().maxs))
    }
}

/// Corners of a terrain cell: (0,0) (1,0) (0,1) (1,1).
#[inline]
fn corners(ground: &HeightGrid, cell: usize) -> [Vector; 4] {
    let (i, j) = (cell % ground.cells, cell / ground.cells);
    let at = |i: usize, j: usize| {
        let z = ground.heights[j * (ground.cells + 1) + i];
        Vector::new(i as f32 * ground.size, j as f32 * ground.size, z)
    };
    [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]
}
