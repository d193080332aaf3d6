//! What a camera sees of boxes in voxel coordinates.

use crate::manifest::{Bounds, Manifest};
use glam::{DMat4, DVec3, DVec4};

/// The depths of clip space that are in the view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// 0 to 1: Vulkan, Direct3D, Metal, WebGPU, reversed or not.
    ZeroToOne,
    /// -1 to 1: OpenGL, WebGL.
    MinusOneToOne,
}

/// A camera, as a tile set's boxes see it.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Planes in voxel coordinates whose positive sides are in the view.
    planes: [DVec4; 6],
    /// The viewing point in voxel coordinates.
    eye: Option<DVec3>,
    /// Depth of a voxel position, for parallel projections.
    depth: DVec4,
    /// Metres per voxel along each axis.
    metres: DVec3,
}

impl View {
    /// The view of a camera. `view_projection` takes the space of the loaded tiles (metres, Y up) to clip
    /// space, as the usual product of projection and view.
    pub fn new(view_projection: DMat4, depth: Depth, manifest: &Manifest) -> Self {
        let place = DMat4::from_cols_array(&manifest.transform);
        let clip = view_projection * place;
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| clip.row(i));
        let near = match depth {
            Depth::ZeroToOne => z,
            Depth::MinusOneToOne => w + z,
        };
        let [a, b, c] = [x, y, w].map(DVec4::truncate);
        // where x, y and w vanish; the planes of a parallel projection have no such point
        let det = a.dot(b.cross(c));
        let eye = -(b.cross(c) * x.w + c.cross(a) * y.w + a.cross(b) * w.w) / det;
        View {
            planes: [w + x, w - x, w + y, w - y, near, w - z],
            eye: eye.is_finite().then_some(eye),
            depth: z,
            metres: DVec3::from([0, 1, 2].map(|i| place.col(i).truncate().length())),
        }
    }

    /// The viewing point in voxel coordinates; `None` for a parallel projection.
    pub fn eye(&self) -> Option<[f64; 3]> {
        self.eye.map(Into::into)
    }

    /// True if a position in voxel coordinates is in the view.
    pub fn contains(&self, position: [f64; 3]) -> bool {
        let p = DVec3::from(position).extend(1.0);
        self.planes.iter().all(|plane| plane.dot(p) >= 0.0)
    }

    /// False only if nothing of a box is in the view. Of boxes outside, a few near the view's edges count
    /// as inside, for each of the six planes is tested by itself.
    pub fn sees(&self, bounds: &Bounds) -> bool {
        let [low, high] = [bounds.min, bounds.max].map(DVec3::from);
        self.planes.iter().all(|plane| {
            let towards = plane.truncate().cmpge(DVec3::ZERO);
            let farthest = DVec3::select(towards, high, low);
            // a plane that is no number hides nothing
            let ahead = plane.dot(farthest.extend(1.0));
            ahead >= 0.0 || ahead.is_nan()
        })
    }

    /// The distance of the viewing point to a box in metres, 0 inside. In a parallel projection the
    /// smallest depth of the box in clip space, which rises with the distance unless depth is reversed.
    pub fn distance(&self, bounds: &Bounds) -> f64 {
        let [low, high] = [bounds.min, bounds.max].map(DVec3::from);
        match self.eye {
            Some(eye) => {
                let off = (low - eye).max(eye - high).max(DVec3::ZERO);
                (off * self.metres).length()
            }
            None => {
                let towards = self.depth.truncate().cmpge(DVec3::ZERO);
                self.depth
                    .dot(DVec3::select(towards, low, high).extend(1.0))
            }
        }
    }
}
