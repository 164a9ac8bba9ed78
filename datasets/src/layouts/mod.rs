//! The layouts that people have, one a file: each becomes plain [`View`](crate::View)s, or a typed error.

pub(crate) mod album;
pub(crate) mod bop;
pub(crate) mod colmap;
pub(crate) mod cub;
pub(crate) mod generated;
pub(crate) mod kaolin;
pub(crate) mod mcmr;
pub(crate) mod middlebury;
pub(crate) mod pascal3d;
pub(crate) mod photos;
pub(crate) mod pix3d;
pub mod pixel2mesh;
pub(crate) mod projections;
pub mod r2n2;
pub(crate) mod single;
pub(crate) mod transforms;
pub(crate) mod turntable;
