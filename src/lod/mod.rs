//! Levels of detail: an octree over the tiles of a set, each node of which stands for 2 x 2 x 2 of the level below
//! with an eighth of their triangles, down to one root, and the same tree in 3D Tiles 1.1.
//!
//! # A node
//! 1. `mesh` joins what the children hold; `border` finds the edges that others continue.
//! 2. `clusters` says which vertices become one, `place` and `quadric` where it lies: what lies on the border is
//!    decided by the border alone (`curves`) and stays in its plane, so nodes of a level meet edge by edge without knowing of
//!    each other. It is a map of vertices to vertices, so what is closed stays closed.
//! 3. `triangles` sums up what is left, `collapse` takes edges away until the ratio is reached. `specks` brings back what
//!    is smaller than a block, `pinches` takes edges apart where a surface touches itself, `folds` turns triangles back
//!    that face against their normals.
//! 4. `distance` measures how far surfaces have moved, `gap` bounds how far the border has moved in its planes, `fins` cover that much on both sides of it, so that
//!    nothing is seen through between nodes of different levels.
//!
//! `build` does these in order, `rows` takes the node apart into the rows of its file. `run` makes level after level, layer by layer, each node once its children are
//! written; `work` is the directory in which all is made before it gets its name, `journal` what is done of a layer; `tileset_json` writes the tree for
//! viewers of 3D Tiles.
//!
//! # Where bytes are decided
//! A node is made of its children's files alone, in their order, and of whole numbers where nodes on both sides of a
//! plane add the same in another order.

mod asked;
mod border;
mod build;
mod clusters;
mod collapse;
mod curves;
mod distance;
mod entry;
mod fins;
mod folds;
mod gap;
mod journal;
mod level;
mod measured;
mod mesh;
mod pinches;
mod place;
mod planes;
mod quadric;
mod rows;
mod run;
mod specks;
mod tetrahedron;
mod tileset_json;
mod triangles;
mod work;

pub use asked::LodOptions;
pub(crate) use measured::{NodePlace, block_and_step, error_of};
pub use run::{LodReport, lod};
pub use work::interrupted;
pub(crate) use work::moving_in;
