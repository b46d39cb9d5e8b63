//! Slots of materials that come, change and go.

use super::*;
use crate::scene::extract::instances::{EntityState, ExtractedInstance};
use bevy::{asset::uuid::Uuid, color::Color, ecs::entity::Entity, math::Affine3A};

fn id(number: u32) -> AssetId<StandardMaterial> {
    AssetId::Uuid { uuid: Uuid::from_u128(number.into()) }
}

/// An instance with a material.  The order of entities is against that of their indices.
fn instance(material: u32) -> ExtractedInstance {
    ExtractedInstance {
        entity: Entity::from_raw_u32(u32::MAX - 1 - material).expect("a valid index").into(),
        mesh: AssetId::default(),
        material: id(material),
        world_from_object: Affine3A::IDENTITY,
        camera_mask: 1,
        casts_shadows: true,
        is_stand_in: false,
        pose: None,
        subsurface: None,
    }
}

/// A frame in which materials are added and removed, and some are used.
fn frame(pool: &mut MaterialPool, added: &[u32], removed: &[u32], used: &[u32]) {
    let mut scene = ExtractedScene { emissive_luminance: 1.0, ..Default::default() };
    let gray = |n: u32| StandardMaterial { metallic: n as f32 / 4096.0, ..Color::WHITE.into() };
    scene.materials.extend(added.iter().map(|&n| (id(n), gray(n))));
    scene.removed_materials.extend(removed.iter().map(|&n| id(n)));
    for instance in used.iter().map(|&n| instance(n)) {
        scene.instances.set(instance.entity, EntityState::Mesh(Some(instance)));
    }
    pool.dirty.clear();
    pool.update_sources(&mut scene);
    pool.make_room(&mut scene.instances, true);
    pool.pack(&TexturePool::default(), false);
}

fn shown(pool: &mut MaterialPool, number: u32) -> Option<f32> {
    let slot = pool.slot_or_assign(id(number))?;
    Some(pool.get(slot)?.metallic * 4096.0)
}

#[test]
fn replacing_materials_reuses_slots_and_packs_only_the_new_ones() {
    let mut pool = MaterialPool::default();
    frame(&mut pool, &[5000], &[], &[5000]);
    for n in 1..1000 {
        frame(&mut pool, &[n], &[n - 1], &[n, 5000]);
        assert_eq!(shown(&mut pool, n), Some(n as f32));
        assert_eq!(pool.dirty.len(), 1, "{n}");
    }
    // The slot of the material before is free a frame later.
    assert_eq!((pool.slots.len(), pool.packed.len(), pool.by_id.len()), (3, 3, 2));
    assert_eq!(pool.edit_revision, 0);
}

#[test]
fn an_edited_material_gets_another_slot_and_an_equal_one_keeps_its_own() {
    let mut pool = MaterialPool::default();
    frame(&mut pool, &[7], &[], &[7]);
    let first = pool.slot_or_assign(id(7)).expect("there is room");
    frame(&mut pool, &[7], &[], &[7]);
    assert_eq!((pool.slot_or_assign(id(7)), pool.dirty.len()), (Some(first), 0), "nothing has changed");
    for n in 0..10 {
        let last = pool.slot_or_assign(id(7)).expect("there is room");
        let mut scene = ExtractedScene { emissive_luminance: 1.0, ..Default::default() };
        scene.materials.insert(id(7), StandardMaterial { metallic: n as f32 / 16.0, ..Default::default() });
        pool.update_sources(&mut scene);
        pool.pack(&TexturePool::default(), false);
        let now = pool.slot_or_assign(id(7)).expect("there is room");
        assert_ne!(now, last);
        assert_eq!(pool.get(now).map(|m| m.metallic), Some(n as f32 / 16.0));
        assert!(pool.get(last).is_some_and(|m| m.metallic != n as f32 / 16.0), "the last frame's material is kept");
    }
    assert_eq!((pool.slots.len(), pool.edit_revision), (2, 0));
}

#[test]
fn materials_beyond_the_limit_have_no_slot_until_one_is_free() {
    let mut pool = MaterialPool { limits: [2, 2], ..Default::default() };
    frame(&mut pool, &[1, 2, 3], &[], &[1, 2, 3]);
    assert_eq!([1, 2, 3].map(|n| shown(&mut pool, n).is_some()), [true, true, false]);
    assert!(pool.is_left_out(id(3)) && !pool.is_left_out(id(4)));
    frame(&mut pool, &[], &[1], &[2, 3]);
    assert_eq!(shown(&mut pool, 3), Some(3.0));
    // Material 3 is loaded but unused, so material 4 gets its slot.
    frame(&mut pool, &[4], &[], &[2, 4]);
    assert_eq!([2, 4].map(|n| shown(&mut pool, n)), [Some(2.0), Some(4.0)]);
    assert!(pool.edit_revision > 0, "slots of the last frame were overwritten");
    assert_eq!(pool.packed.len(), 2);
}

#[test]
fn a_material_that_is_removed_and_added_in_one_frame_is_the_new_one() {
    let mut pool = MaterialPool::default();
    frame(&mut pool, &[7], &[], &[7]);
    frame(&mut pool, &[7, 8], &[7], &[7, 8]);
    assert_eq!([7, 8].map(|n| shown(&mut pool, n)), [Some(7.0), Some(8.0)]);
    assert_eq!(pool.slots.len(), 3);
}
