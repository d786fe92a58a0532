use std::error::Error;
use std::fs;
use std::path::Path;
use vsf::plot::PlotError;

/// Writes a picture into a folder, which is created, and says so. Nothing is drawn without a folder.
///
/// # Errors
/// What cannot be drawn or written.
pub fn write_picture(
    folder: Option<&Path>,
    name: &str,
    draw: impl FnOnce() -> Result<Vec<u8>, PlotError>,
) -> Result<(), Box<dyn Error>> {
    if let Some(folder) = folder {
        let path = folder.join(name);
        fs::create_dir_all(folder)?;
        fs::write(&path, draw()?)?;
        println!("wrote {}", path.display());
    }
    Ok(())
}
