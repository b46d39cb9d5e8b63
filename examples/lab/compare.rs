//! Compares a picture with a reference, both from files.

use bevy::math::UVec2;
use bevy_restir_support::{
    arguments, exr_file, files,
    picture::{read_png, write_png},
};
use std::path::{Path, PathBuf};

use crate::{
    difference::{Difference, is_finite},
    error::Picture,
    output::{Output, provenance},
    panels,
    table::Table,
};

/// Compares a picture with a reference: a line of JSON, with `null` for undefined figures, and a table.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A linear .exr file, or a .png file, whose colors are compared as linear light. Pixels that are not finite are counted and compared as
    /// black.
    picture: PathBuf,
    /// The reference, a file of the same size.
    reference: PathBuf,
    #[command(flatten)]
    output: Output,
    /// Side of a tile in pixels; incomplete tiles at the right and at the bottom are left out.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    tile: u32,
    /// Writes the picture beside four times its difference from the reference to this .png file.
    #[arg(long, value_name = "FILE.png", value_parser = arguments::png_file)]
    difference: Option<PathBuf>,
}

/// The table's name.
const NAME: &str = "compare";

impl Args {
    /// Fails if `--difference` names one of the pictures.
    pub fn check(&self) -> Result<(), String> {
        let Some(path) = &self.difference else { return Ok(()) };
        let is_same =
            |other: &Path| path.canonicalize().is_ok_and(|path| other.canonicalize().is_ok_and(|other| path == other));
        match is_same(&self.picture) || is_same(&self.reference) {
            true => Err(format!("--difference would overwrite {}", path.display())),
            false => Ok(()),
        }
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    let (size, picture) = read(&args.picture)?;
    let (wanted, reference) = read_reference(&args.reference)?;
    if size != wanted {
        let (of, other) = (args.picture.display(), args.reference.display());
        return Err(format!("{of}: it has {} x {} pixels, {other} has {} x {}", size.x, size.y, wanted.x, wanted.y));
    }
    args.output.check(NAME)?;
    if let Some(path) = &args.difference {
        files::check(path)?;
        write_png(path, panels::with_error(size, &picture, &reference))?;
    }
    let tile = args.tile as usize;
    let difference = Difference::new(picture, &reference, size, tile);
    let mut header = provenance(None);
    header.push(format!("{} x {} pixels, tiles of {tile} x {tile}", size.x, size.y));
    let name = args.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    args.output.write(NAME, &Table { header, columns: vec![(name, difference.rows())], notes: Vec::new() })?;
    println!("{}", difference.json());
    Ok(())
}

/// Reads a reference, as [`read`] does.  All of its pixels must be finite.
pub fn read_reference(path: &Path) -> Result<(UVec2, Picture), String> {
    let (size, picture) = read(path)?;
    match picture.iter().filter(|pixel| !is_finite(pixel)).count() {
        0 => Ok((size, picture)),
        unknown => Err(format!("{}: {unknown} pixels of the reference are not finite", path.display())),
    }
}

/// Reads the size and the channels of a file.
pub fn read(path: &Path) -> Result<(UVec2, Picture), String> {
    if path.extension().is_some_and(|e| e == "png") {
        let (size, pixels) = read_png(path)?;
        return Ok((size, pixels.into_iter().map(|p| p.map(f64::from)).collect()));
    }
    let (size, pixels) = exr_file::read(path)?;
    Ok((size, pixels.into_iter().map(|[r, g, b, _]| [r, g, b].map(f64::from)).collect()))
}
