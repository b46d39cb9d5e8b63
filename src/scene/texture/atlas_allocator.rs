//! Where images lie in the atlas: pages of which size and how many, and which images find no place.  Nothing here touches the GPU.
//!
//! A packer takes nothing back.  Where an image finds no place in the pages that there are, all that are wanted are packed again: into
//! the same pages where that frees enough of them, into half as many more otherwise, so that images are copied a few times each however they
//! come and go.

use bevy::{
    asset::AssetId,
    image::Image,
    math::UVec2,
    platform::collections::{HashMap, HashSet},
};

use crate::scene::texture::atlas::{Placement, ShelfPacker};

/// Smallest side of a page, texels.
const MIN_PAGE: u32 = 256;
/// Texels, all levels left out, below which an atlas is not worth making smaller.
const SMALL: u64 = 1 << 22;

/// The largest pages and the most that a device has.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    pub page: u32,
    pub layers: u32,
}

/// An image and its size in the atlas.
pub(crate) type Item = (AssetId<Image>, UVec2);

/// A packer, and what it was given.
struct Packing {
    packer: ShelfPacker,
    placed: Vec<(AssetId<Image>, Placement)>,
    left: Vec<Item>,
}

impl Packing {
    /// Adds images to what is packed, in pages up to so many.
    fn onto(mut packer: ShelfPacker, images: &[Item], pages: u32) -> Self {
        let (mut placed, mut left) = (Vec::new(), Vec::new());
        for &(id, size) in images {
            match packer.place(size, pages) {
                Some(place) => placed.push((id, place)),
                None => left.push((id, size)),
            }
        }
        Self { packer, placed, left }
    }

    /// Packs images into the smallest pages that hold them all; `None` where none do.
    fn fresh(images: &[Item], limits: Limits) -> Option<Self> {
        let largest = images.iter().map(|(_, size)| size.max_element()).max().unwrap_or(1);
        let mut page = largest.next_power_of_two().max(MIN_PAGE).min(limits.page);
        loop {
            let packing = Self::onto(ShelfPacker::of_page(page), images, limits.layers);
            if packing.left.is_empty() {
                return Some(packing);
            }
            if page == limits.page {
                return None;
            }
            page = (2 * page).min(limits.page);
        }
    }

    fn area(&self) -> u64 {
        area(self.packer.page, self.packer.pages)
    }
}

fn area(page: u32, layers: u32) -> u64 {
    u64::from(page).pow(2) * u64::from(layers)
}

fn texels(images: &[Item]) -> u64 {
    images.iter().map(|(_, size)| u64::from(size.x) * u64::from(size.y)).sum()
}

/// In the order that fills shelves best; whatever order they come in, they end at the same places.
fn sort(images: &mut [Item]) {
    images.sort_unstable_by_key(|&(id, size)| (core::cmp::Reverse((size.y, size.x)), id));
}

/// The places of images.
#[derive(Default)]
pub(crate) struct AtlasAllocator {
    placed: HashMap<AssetId<Image>, Placement>,
    packer: ShelfPacker,
    /// Pages of the atlas: those that the packer began, and some to come.
    layers: u32,
    /// Images that found no place, as large as they were then.
    left_out: HashMap<AssetId<Image>, UVec2>,
}

impl AtlasAllocator {
    pub(crate) fn get(&self, id: AssetId<Image>) -> Option<&Placement> {
        self.placed.get(&id)
    }

    pub(crate) fn images(&self) -> impl Iterator<Item = AssetId<Image>> {
        self.placed.keys().copied()
    }

    /// Side and number of the pages that the atlas is to have.
    pub(crate) fn pages(&self) -> [u32; 2] {
        [self.packer.page, self.layers]
    }

    /// Takes its place from an image that is no more; true where it had one.
    pub(crate) fn forget(&mut self, id: AssetId<Image>) -> bool {
        self.left_out.remove(&id);
        let had_place = self.placed.remove(&id).is_some();
        if had_place {
            self.left_out.clear();
        }
        had_place
    }

    /// Whether an image found no place, and nothing gave it hope since.
    pub(crate) fn is_left_out(&self, id: AssetId<Image>, size: UVec2) -> bool {
        self.left_out.get(&id) == Some(&size)
    }

    pub(crate) fn left_out(&self) -> usize {
        self.left_out.len()
    }

    /// Where some found no place, those make room that are not wanted any more.
    pub(crate) fn make_room(&mut self, wanted: &HashSet<AssetId<Image>>) {
        if self.left_out.is_empty() {
            return;
        }
        let before = self.placed.len();
        self.placed.retain(|id, _| wanted.contains(id));
        if self.placed.len() < before {
            self.left_out.clear();
        }
    }

    /// Gives places to images that have none of their size.  True where all places are others than before.
    pub(crate) fn place(
        &mut self,
        mut new: Vec<Item>,
        limits: Limits,
        is_wanted: impl Fn(AssetId<Image>) -> bool,
    ) -> bool {
        new.retain(|(id, size)| self.placed.get(id).is_none_or(|place| place.size != *size));
        if new.is_empty() {
            return false;
        }
        for (id, _) in &new {
            self.forget(*id);
        }
        sort(&mut new);
        let mut kept: Vec<Item> =
            self.placed.iter().filter(|(id, _)| is_wanted(**id)).map(|(id, place)| (*id, place.size)).collect();
        let added = Packing::onto(self.packer.clone(), &new, self.layers);
        let is_roomy = self.area() > SMALL && 4 * (texels(&kept) + texels(&new)) < self.area();
        if added.left.is_empty() && !is_roomy {
            return self.extend(added);
        }
        let dead = self.packer.given.saturating_sub(texels(&kept));
        let mut all = [kept.as_slice(), new.as_slice()].concat();
        sort(&mut all);
        match Packing::fresh(&all, limits) {
            Some(fresh) if added.left.is_empty() && 2 * fresh.area() > self.area() => self.extend(added),
            Some(fresh) => {
                let layers = self.layers_for(&fresh.packer, dead).min(limits.layers);
                self.replace(fresh, layers)
            }
            None => {
                sort(&mut kept);
                self.fill(added, &kept, &new, limits)
            }
        }
    }

    /// Of an atlas that cannot hold all: those that have a place keep one.
    fn fill(&mut self, added: Packing, kept: &[Item], new: &[Item], limits: Limits) -> bool {
        let first = Packing::onto(ShelfPacker::of_page(limits.page), kept, limits.layers);
        if first.left.is_empty() {
            let mut full = Packing::onto(first.packer, new, limits.layers);
            if full.left.len() < added.left.len() {
                full.placed.extend(first.placed);
                return self.replace(full, limits.layers);
            }
        }
        self.extend(added)
    }

    /// How many pages are to hold what a packer holds.
    fn layers_for(&self, packer: &ShelfPacker, dead: u64) -> u32 {
        let (now, needed) = (self.layers, packer.pages);
        if packer.page != self.packer.page {
            needed
        } else if needed > now || (4 * needed > 3 * now && 4 * dead < self.area()) {
            needed.max(now + (now / 2).max(1))
        } else if 2 * needed > now {
            now
        } else {
            needed + needed / 2
        }
    }

    fn area(&self) -> u64 {
        area(self.packer.page, self.layers)
    }

    fn extend(&mut self, added: Packing) -> bool {
        self.packer = added.packer;
        self.placed.extend(added.placed);
        self.left_out.extend(added.left);
        false
    }

    fn replace(&mut self, packing: Packing, layers: u32) -> bool {
        self.placed.clear();
        self.layers = layers;
        self.extend(packing);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::uuid::Uuid;

    const WIDE: Limits = Limits { page: 8192, layers: 2048 };

    fn image(number: u32) -> AssetId<Image> {
        AssetId::Uuid { uuid: Uuid::from_u128(number.into()) }
    }

    /// AtlasAllocator images that all are wanted; true where all moved.
    fn add(places: &mut AtlasAllocator, images: impl IntoIterator<Item = (u32, u32)>, limits: Limits) -> bool {
        let new = images.into_iter().map(|(number, side)| (image(number), UVec2::splat(side))).collect();
        places.place(new, limits, |_| true)
    }

    /// All lie within the pages, and none on another.
    fn check(places: &AtlasAllocator) {
        let [page, layers] = places.pages();
        let all: Vec<_> = places.placed.values().collect();
        for (i, a) in all.iter().enumerate() {
            assert!(a.layer < layers && (a.corner + a.size).max_element() <= page, "{a:?}");
            for b in &all[..i] {
                let apart = a.corner.cmpge(b.corner + b.size).any() || b.corner.cmpge(a.corner + a.size).any();
                assert!(a.layer != b.layer || apart, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn replacing_images_many_times_does_not_grow_the_atlas() {
        let mut places = AtlasAllocator::default();
        let side = |i: u32| 40 + i * 7 % 60;
        add(&mut places, (0..40).map(|i| (i, side(i))), WIDE);
        let (mut moves, before) = (0, places.pages());
        for i in 40..4000 {
            assert!(places.forget(image(i - 40)));
            moves += u32::from(add(&mut places, [(i, side(i))], WIDE));
            assert_eq!(places.images().count(), 40);
        }
        check(&places);
        eprintln!("{before:?} became {:?}, all moved {moves} times", places.pages());
        assert!(places.pages()[0] == 256 && places.pages()[1] <= 2 * before[1], "{:?}", places.pages());
        // Every time a quarter of the atlas was dead: some ten images.
        assert!(moves < 3960 / 8, "{moves}");
    }

    #[test]
    fn images_that_nothing_wants_lose_their_places_where_others_need_them() {
        let mut places = AtlasAllocator::default();
        for i in 0..1000 {
            // None is dropped, and none is used for long.
            let new = vec![(image(i), UVec2::splat(100))];
            places.place(new, WIDE, |id| (i.saturating_sub(5)..=i).any(|i| id == image(i)));
            assert!((i.saturating_sub(5)..=i).all(|i| places.get(image(i)).is_some()));
        }
        check(&places);
        assert!(places.pages()[1] <= 4, "{:?}", places.pages());
    }

    #[test]
    fn an_atlas_that_fills_grows_by_half() {
        let mut places = AtlasAllocator::default();
        let moves = (0..1000).filter(|i| add(&mut places, [(*i, 250)], WIDE)).count();
        check(&places);
        eprintln!("{moves} moves to {:?}", places.pages());
        assert!(moves <= 20 && (1000..=1500).contains(&places.pages()[1]), "{moves} {:?}", places.pages());
        // A fresh load takes what it needs.
        let mut fresh = AtlasAllocator::default();
        add(&mut fresh, (0..1000).map(|i| (i, 250)), WIDE);
        assert_eq!(fresh.pages(), [256, 1000]);
    }

    #[test]
    fn a_large_atlas_of_which_little_is_left_becomes_small() {
        let mut places = AtlasAllocator::default();
        add(&mut places, (0..200).map(|i| (i, 250)).chain([(200, 2000)]), WIDE);
        for i in 2..=200 {
            places.forget(image(i));
        }
        assert_eq!(places.pages()[0], 2048);
        add(&mut places, [(300, 250)], WIDE);
        check(&places);
        assert_eq!(places.pages(), [256, 3]);
        assert_eq!(places.images().count(), 3);
    }

    #[test]
    fn pages_grow_where_there_cannot_be_more() {
        let mut places = AtlasAllocator::default();
        let limits = Limits { page: 1024, layers: 4 };
        for i in 0..50 {
            add(&mut places, [(i, 250)], limits);
        }
        check(&places);
        assert_eq!((places.left_out(), places.images().count()), (0, 50));
        assert_eq!(places.pages()[0], 1024);
    }

    #[test]
    fn a_full_atlas_keeps_what_it_holds_and_takes_others_when_there_is_room() {
        let mut places = AtlasAllocator::default();
        let limits = Limits { page: 512, layers: 2 };
        // Four a page.
        add(&mut places, (0..6).map(|i| (i, 256)), limits);
        add(&mut places, (6..12).map(|i| (i, 256)), limits);
        check(&places);
        assert_eq!((places.left_out(), places.images().count()), (4, 8));
        assert!((0..8).all(|i| places.get(image(i)).is_some()), "those that had places, and the first of the others");
        // One that is edited is not asked for again, one that is smaller is.
        assert!(places.is_left_out(image(9), UVec2::splat(256)) && !places.is_left_out(image(9), UVec2::splat(5)));
        let before: Vec<_> = (0..8).map(|i| places.get(image(i)).copied()).collect();
        assert!(!add(&mut places, (8..13).map(|i| (i, 256)), limits), "nothing is copied again for nothing");
        assert_eq!(before, (0..8).map(|i| places.get(image(i)).copied()).collect::<Vec<_>>());
        // One goes: they may try again.
        places.forget(image(3));
        assert_eq!(places.left_out(), 0);
        add(&mut places, (8..12).map(|i| (i, 256)), limits);
        check(&places);
        assert!(places.get(image(8)).is_some() && places.left_out() == 3);
        // Two are not wanted any more.
        places.make_room(&(2..12).map(image).collect());
        assert_eq!(places.left_out(), 0);
        add(&mut places, (9..12).map(|i| (i, 256)), limits);
        check(&places);
        assert!(places.get(image(9)).is_some() && places.get(image(10)).is_some() && places.left_out() == 1);
    }
}
