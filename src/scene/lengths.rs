//! Lengths of the tables of the scene, for tests, which find leaks by their growth.

use bevy::{app::App, render::RenderApp};

use super::{
    geometry::{bodies::BodyPool, instances::InstancePool, meshes::MeshPool},
    light::lights::LightPool,
    material::{materials::MaterialPool, subsurface::SubsurfacePool},
    texture::textures::TexturePool,
};

/// Names and lengths of the tables, on the CPU and of the used part on the GPU; nothing where the plugin is off.
pub fn table_lengths(app: &App) -> Vec<(&'static str, usize)> {
    let Some(world) = app.get_sub_app(RenderApp).map(|render_app| render_app.world()) else { return Vec::new() };
    [
        world.get_resource::<MeshPool>().map(MeshPool::lengths),
        world.get_resource::<BodyPool>().map(BodyPool::lengths),
        world.get_resource::<InstancePool>().map(InstancePool::lengths),
        world.get_resource::<MaterialPool>().map(MaterialPool::lengths),
        world.get_resource::<SubsurfacePool>().map(SubsurfacePool::lengths),
        world.get_resource::<LightPool>().map(LightPool::lengths),
        world.get_resource::<TexturePool>().map(TexturePool::lengths),
    ]
    .into_iter()
    .flatten()
    .flatten()
    .collect()
}
