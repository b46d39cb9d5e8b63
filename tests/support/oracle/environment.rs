//! The environment in f64: a bilinear equirectangular map, and the table that importance-samples it.
