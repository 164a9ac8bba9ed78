//! diff-raster
