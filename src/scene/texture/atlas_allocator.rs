//! Allocates rectangles of the texture atlas: decides the size and number of its pages, the rectangle of each image, and which images are left
//! out.  Nothing here touches the GPU.
//!
//! The packer cannot free rectangles.  If an image does not fit, all images in use are packed again: into the same pages if that frees
//! enough of them, and otherwise into 1.5 times as many pages.  Each image is therefore copied only a few times, in whatever order images
//! are added and removed.
//!
//! Temporal reuse also reads the pixels of the last frame.  So the first edit of an image gives it a second rectangle, and each further edit
//! changes the roles of the two.  The rectangle of an image that has another size or is removed keeps its content until all images are packed
//! again.

use bevy::{
    asset::AssetId,
    image::Image,
    math::UVec2,
    platform::collections::{HashMap, HashSet},
};

use crate::scene::texture::atlas::{Placement, ShelfPacker};

/// Smallest side length of a page, texels.
const MIN_PAGE: u32 = 256;
/// Texels of the finest level below which the atlas never shrinks.
const MIN_SHRINK_TEXELS: u64 = 1 << 22;

/// Largest side length and number of pages on a device.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    pub page: u32,
    pub layers: u32,
}

/// An image and its size in the atlas.
pub(crate) type Item = (AssetId<Image>, UVec2);

/// A packer with the images that it has placed and those that did not fit.
struct Packing {
    packer: ShelfPacker,
    placed: Vec<(AssetId<Image>, Placement)>,
    left_out: Vec<Item>,
}

impl Packing {
    /// Adds images to a packer with up to `pages` pages.
    fn onto(mut packer: ShelfPacker, images: &[Item], pages: u32) -> Self {
        let (mut placed, mut left_out) = (Vec::new(), Vec::new());
        for &(id, size) in images {
            match packer.place(size, pages) {
                Some(placement) => placed.push((id, placement)),
                None => left_out.push((id, size)),
            }
        }
        Self { packer, placed, left_out }
    }

    /// Packs images into the smallest pages that can hold all of them; `None` if even the largest pages cannot.
    fn fresh(images: &[Item], limits: Limits) -> Option<Self> {
        let largest = images.iter().map(|(_, size)| size.max_element()).max().unwrap_or(1);
        let mut page = largest.next_power_of_two().max(MIN_PAGE).min(limits.page);
        loop {
            let packing = Self::onto(ShelfPacker::with_page_size(page), images, limits.layers);
            if packing.left_out.is_empty() {
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

/// The sizes of the rectangles of images in use.
fn items<'a>(
    rectangles: impl Iterator<Item = (&'a AssetId<Image>, &'a Placement)>,
    is_used: impl Fn(AssetId<Image>) -> bool,
) -> Vec<Item> {
    rectangles.filter(|(id, _)| is_used(**id)).map(|(id, placement)| (*id, placement.size)).collect()
}

fn texels(images: &[Item]) -> u64 {
    images.iter().map(|(_, size)| u64::from(size.x) * u64::from(size.y)).sum()
}

/// Sorts images in the order that fills shelves best.  The result does not depend on the order in which images were added.
fn sort(images: &mut [Item]) {
    images.sort_unstable_by_key(|&(id, size)| (core::cmp::Reverse((size.y, size.x)), id));
}

/// What has become of the rectangles of the atlas.
#[derive(Default)]
pub(crate) struct Moves {
    /// All images have other rectangles, and the old contents of the atlas are lost.
    pub all: bool,
    /// Edited images for which there is no second rectangle: their new pixels replace the old ones.
    pub overwritten: Vec<AssetId<Image>>,
}

/// Rectangles of the images in the atlas.
#[derive(Clone, Default)]
pub(crate) struct AtlasAllocator {
    placed: HashMap<AssetId<Image>, Placement>,
    /// Second rectangles of images that have been edited, of the same size as the first ones.  After an edit, the second rectangle has the
    /// pixels of the last frame.
    second: HashMap<AssetId<Image>, Placement>,
    /// There was no room for a second rectangle, and no space has been freed since.
    lacks_second: bool,
    packer: ShelfPacker,
    /// Number of pages of the atlas; the packer may not use all of them yet.
    layers: u32,
    /// Images that did not fit, with their sizes.
    left_out: HashMap<AssetId<Image>, UVec2>,
}

impl AtlasAllocator {
    pub(crate) fn get(&self, id: AssetId<Image>) -> Option<&Placement> {
        self.placed.get(&id)
    }

    pub(crate) fn images(&self) -> impl Iterator<Item = AssetId<Image>> {
        self.placed.keys().copied()
    }

    /// Side length and number of the pages that the atlas needs.
    pub(crate) fn pages(&self) -> [u32; 2] {
        [self.packer.page, self.layers]
    }

    /// Whether an image has a rectangle of this size.
    pub(crate) fn has_place(&self, id: AssetId<Image>, size: UVec2) -> bool {
        self.placed.get(&id).is_some_and(|placement| placement.size == size)
    }

    /// Whether an edited image needs a second rectangle for its new pixels.
    pub(crate) fn needs_second(&self, id: AssetId<Image>, size: UVec2) -> bool {
        self.has_place(id, size) && !self.lacks_second && !self.second.contains_key(&id)
    }

    /// Gives no image a second rectangle until space is freed.
    pub(crate) fn stop_doubling(&mut self) {
        self.lacks_second = true;
    }

    /// Releases the rectangles of a removed image; true if it had one.
    pub(crate) fn release(&mut self, id: AssetId<Image>) -> bool {
        self.left_out.remove(&id);
        self.second.remove(&id);
        let was_placed = self.placed.remove(&id).is_some();
        if was_placed {
            // The others may fit now.
            self.left_out.clear();
            self.lacks_second = false;
        }
        was_placed
    }

    /// Whether an image of this size did not fit, and no space has been freed since.
    pub(crate) fn is_left_out(&self, id: AssetId<Image>, size: UVec2) -> bool {
        self.left_out.get(&id) == Some(&size)
    }

    /// Number of images that do not fit.
    pub(crate) fn left_out(&self) -> usize {
        self.left_out.len()
    }

    /// Releases unused images if some images did not fit.
    pub(crate) fn make_room(&mut self, used: &HashSet<AssetId<Image>>) {
        if self.left_out.is_empty() {
            return;
        }
        let before = self.placed.len();
        self.placed.retain(|id, _| used.contains(id));
        if self.placed.len() < before {
            self.second.retain(|id, _| used.contains(id));
            self.left_out.clear();
            self.lacks_second = false;
        }
    }

    /// Places new and edited images.  Those of other sizes than before lose their old rectangles.
    pub(crate) fn place(
        &mut self,
        mut new: Vec<Item>,
        limits: Limits,
        is_used: impl Fn(AssetId<Image>) -> bool,
    ) -> Moves {
        let mut moves = Moves::default();
        new.retain(|&(id, size)| !self.exchange(id, size));
        if self.lacks_second {
            moves.overwritten = self.take_edited(&mut new);
        }
        if new.is_empty() {
            return moves;
        }
        for &(id, size) in &new {
            if !self.has_place(id, size) {
                self.release(id);
            }
        }
        sort(&mut new);
        // An edited image is in both lists, and so gets a second rectangle.
        let kept = items(self.placed.iter().chain(self.second.iter()), &is_used);
        let added = Packing::onto(self.packer.clone(), &new, self.layers);
        let is_oversized = self.area() > MIN_SHRINK_TEXELS && 4 * (texels(&kept) + texels(&new)) < self.area();
        if added.left_out.is_empty() && !is_oversized {
            self.extend(added);
            return moves;
        }
        // Texels of released and unused images, which only a new packing can free.
        let dead = self.packer.placed_texels.saturating_sub(texels(&kept));
        let mut all = [kept.as_slice(), new.as_slice()].concat();
        sort(&mut all);
        match Packing::fresh(&all, limits) {
            Some(fresh) if added.left_out.is_empty() && 2 * fresh.area() > self.area() => self.extend(added),
            Some(fresh) => {
                let layers = self.layers_for(&fresh.packer, dead).min(limits.layers);
                self.replace(fresh, layers);
                moves.all = true;
            }
            None => {
                moves.overwritten.extend(self.take_edited(&mut new));
                moves.all = self.fill(&new, limits, &is_used);
                self.lacks_second = true;
            }
        }
        moves
    }

    /// Changes the roles of the two rectangles of an edited image; false if it has only one, or if its size has changed.
    fn exchange(&mut self, id: AssetId<Image>, size: UVec2) -> bool {
        match (self.placed.get_mut(&id), self.second.get_mut(&id)) {
            (Some(first), Some(second)) if first.size == size => {
                core::mem::swap(first, second);
                true
            }
            _ => false,
        }
    }

    /// Takes the images that have a rectangle of their size out of a list.
    fn take_edited(&self, new: &mut Vec<Item>) -> Vec<AssetId<Image>> {
        new.extract_if(.., |(id, size)| self.has_place(*id, *size)).map(|(id, _)| id).collect()
    }

    /// Fills an atlas that cannot hold all images: images that have a rectangle keep one, though perhaps elsewhere.  True if the rectangles
    /// of all images have changed.
    fn fill(&mut self, new: &[Item], limits: Limits, is_used: impl Fn(AssetId<Image>) -> bool) -> bool {
        let mut kept = items(self.placed.iter(), is_used);
        sort(&mut kept);
        let added = Packing::onto(self.packer.clone(), new, self.layers);
        let first = Packing::onto(ShelfPacker::with_page_size(limits.page), &kept, limits.layers);
        if first.left_out.is_empty() {
            let mut full = Packing::onto(first.packer, new, limits.layers);
            if full.left_out.len() < added.left_out.len() {
                full.placed.extend(first.placed);
                self.replace(full, limits.layers);
                return true;
            }
        }
        self.extend(added);
        false
    }

    /// Number of pages for a new packing: with reserve where the atlas grows, so that it is not replaced too often.  `dead`: texels that the
    /// old packing wasted.
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

    /// Takes over a packing.  An image that it places twice, or that already has a rectangle, has two of them.
    fn extend(&mut self, added: Packing) {
        self.packer = added.packer;
        for (id, placement) in added.placed {
            if let Some(last) = self.placed.insert(id, placement) {
                self.second.insert(id, last);
            }
        }
        self.left_out.extend(added.left_out);
    }

    fn replace(&mut self, packing: Packing, layers: u32) {
        self.placed.clear();
        self.second.clear();
        self.lacks_second = false;
        self.layers = layers;
        self.extend(packing);
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

    /// Places images that are all in use; true if all have moved.
    fn add(allocator: &mut AtlasAllocator, images: impl IntoIterator<Item = (u32, u32)>, limits: Limits) -> bool {
        let new = images.into_iter().map(|(number, side)| (image(number), UVec2::splat(side))).collect();
        allocator.place(new, limits, |_| true).all
    }

    /// All rectangles lie within the pages and are disjoint.
    fn check(allocator: &AtlasAllocator) {
        let [page, layers] = allocator.pages();
        let all: Vec<_> = allocator.placed.values().chain(allocator.second.values()).collect();
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
        let mut allocator = AtlasAllocator::default();
        let side = |i: u32| 40 + i * 7 % 60;
        add(&mut allocator, (0..40).map(|i| (i, side(i))), WIDE);
        let (mut moves, before) = (0, allocator.pages());
        for i in 40..4000 {
            assert!(allocator.release(image(i - 40)));
            moves += u32::from(add(&mut allocator, [(i, side(i))], WIDE));
            assert_eq!(allocator.images().count(), 40);
        }
        check(&allocator);
        eprintln!("{before:?} became {:?}, all moved {moves} times", allocator.pages());
        assert!(allocator.pages()[0] == 256 && allocator.pages()[1] <= 2 * before[1], "{:?}", allocator.pages());
        // Images move only after a quarter of the atlas, some ten images, has been released.
        assert!(moves < 3960 / 8, "{moves}");
    }

    /// The pixels of the last frame are never overwritten, unless all images move.
    #[test]
    fn edits_of_an_image_alternate_between_two_rectangles() {
        // A small image has room for its second rectangle on its page.  For a large one a page is added, once.
        for (side, all_moves, pages) in [(100, 0, 1), (250, 1, 3)] {
            let mut allocator = AtlasAllocator::default();
            add(&mut allocator, [(0, side), (1, 60)], WIDE);
            let place = |allocator: &AtlasAllocator| allocator.get(image(0)).copied().expect("it has a place");
            let (mut last, mut moves) = (place(&allocator), 0);
            for edit in 0..100 {
                let moved = add(&mut allocator, [(0, side)], WIDE);
                assert!(moved || place(&allocator) != last, "edit {edit} of an image of {side}");
                moves += u32::from(moved);
                last = place(&allocator);
                check(&allocator);
            }
            assert_eq!((moves, allocator.pages()), (all_moves, [256, pages]), "{side}");
            // With another size, it has one rectangle, until it is edited.
            add(&mut allocator, [(0, 30)], WIDE);
            assert!(allocator.second.is_empty() && allocator.images().count() == 2);
            check(&allocator);
            assert!(!add(&mut allocator, [(0, 30)], WIDE) && allocator.second.len() == 1);
            assert!(allocator.release(image(0)) && allocator.second.is_empty());
        }
    }

    #[test]
    fn an_edited_image_keeps_its_rectangle_where_there_is_no_room_for_two() {
        let mut allocator = AtlasAllocator::default();
        let limits = Limits { page: 512, layers: 2 };
        // Four images fit on a page.
        add(&mut allocator, (0..7).map(|i| (i, 256)), limits);
        let overwritten = |allocator: &mut AtlasAllocator, number: u32| {
            let before = allocator.get(image(number)).copied();
            let moves = allocator.place(vec![(image(number), UVec2::splat(256))], limits, |_| true);
            check(allocator);
            assert!(!moves.all);
            assert_eq!(moves.overwritten.is_empty(), allocator.get(image(number)).copied() != before);
            moves.overwritten
        };
        // One rectangle is left.
        assert!(overwritten(&mut allocator, 0).is_empty());
        for _ in 0..2 {
            assert_eq!(overwritten(&mut allocator, 1), vec![image(1)]);
            assert_eq!(allocator.left_out(), 0);
        }
        assert!(overwritten(&mut allocator, 0).is_empty(), "it has two rectangles");
        // An image that is new matters more than a second rectangle.
        assert!(add(&mut allocator, [(7, 256)], limits));
        assert!(allocator.second.is_empty() && allocator.images().count() == 8);
        check(&allocator);
    }

    #[test]
    fn unused_images_lose_their_space_when_others_need_it() {
        let mut allocator = AtlasAllocator::default();
        for i in 0..1000 {
            // No image is removed, but each is used for a few frames only.
            let new = vec![(image(i), UVec2::splat(100))];
            allocator.place(new, WIDE, |id| (i.saturating_sub(5)..=i).any(|i| id == image(i)));
            assert!((i.saturating_sub(5)..=i).all(|i| allocator.get(image(i)).is_some()));
        }
        check(&allocator);
        assert!(allocator.pages()[1] <= 4, "{:?}", allocator.pages());
    }

    #[test]
    fn an_atlas_that_fills_grows_by_half() {
        let mut allocator = AtlasAllocator::default();
        let moves = (0..1000).filter(|i| add(&mut allocator, [(*i, 250)], WIDE)).count();
        check(&allocator);
        eprintln!("{moves} moves to {:?}", allocator.pages());
        assert!(moves <= 20 && (1000..=1500).contains(&allocator.pages()[1]), "{moves} {:?}", allocator.pages());
        // A new scene gets no reserve.
        let mut fresh = AtlasAllocator::default();
        add(&mut fresh, (0..1000).map(|i| (i, 250)), WIDE);
        assert_eq!(fresh.pages(), [256, 1000]);
    }

    #[test]
    fn a_large_atlas_shrinks_when_little_of_it_is_used() {
        let mut allocator = AtlasAllocator::default();
        add(&mut allocator, (0..200).map(|i| (i, 250)).chain([(200, 2000)]), WIDE);
        for i in 2..=200 {
            allocator.release(image(i));
        }
        assert_eq!(allocator.pages()[0], 2048);
        add(&mut allocator, [(300, 250)], WIDE);
        check(&allocator);
        assert_eq!(allocator.pages(), [256, 3]);
        assert_eq!(allocator.images().count(), 3);
    }

    #[test]
    fn pages_become_larger_when_their_number_is_at_the_limit() {
        let mut allocator = AtlasAllocator::default();
        let limits = Limits { page: 1024, layers: 4 };
        for i in 0..50 {
            add(&mut allocator, [(i, 250)], limits);
        }
        check(&allocator);
        assert_eq!((allocator.left_out(), allocator.images().count()), (0, 50));
        assert_eq!(allocator.pages()[0], 1024);
    }

    #[test]
    fn a_full_atlas_keeps_its_images_and_takes_others_when_space_is_freed() {
        let mut allocator = AtlasAllocator::default();
        let limits = Limits { page: 512, layers: 2 };
        // Four images fit on a page.
        add(&mut allocator, (0..6).map(|i| (i, 256)), limits);
        add(&mut allocator, (6..12).map(|i| (i, 256)), limits);
        check(&allocator);
        assert_eq!((allocator.left_out(), allocator.images().count()), (4, 8));
        assert!(
            (0..8).all(|i| allocator.get(image(i)).is_some()),
            "the images that had a rectangle, and the first of the others"
        );
        // An edited image of the same size does not fit either; a smaller one may.
        assert!(
            allocator.is_left_out(image(9), UVec2::splat(256)) && !allocator.is_left_out(image(9), UVec2::splat(5))
        );
        let before: Vec<_> = (0..8).map(|i| allocator.get(image(i)).copied()).collect();
        assert!(!add(&mut allocator, (8..13).map(|i| (i, 256)), limits), "no image moves in vain");
        assert_eq!(before, (0..8).map(|i| allocator.get(image(i)).copied()).collect::<Vec<_>>());
        // When one image is removed, the others may fit.
        allocator.release(image(3));
        assert_eq!(allocator.left_out(), 0);
        add(&mut allocator, (8..12).map(|i| (i, 256)), limits);
        check(&allocator);
        assert!(allocator.get(image(8)).is_some() && allocator.left_out() == 3);
        // Two images are no longer used.
        allocator.make_room(&(2..12).map(image).collect());
        assert_eq!(allocator.left_out(), 0);
        add(&mut allocator, (9..12).map(|i| (i, 256)), limits);
        check(&allocator);
        assert!(allocator.get(image(9)).is_some() && allocator.get(image(10)).is_some() && allocator.left_out() == 1);
    }
}
