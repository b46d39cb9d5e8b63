//! Pictures that an app renders.

use bevy::prelude::*;

/// The mean radiance of every pixel, in rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub size: UVec2,
    pub pixels: Vec<[f32; 3]>,
    /// The number of accumulated frames.
    pub samples: u32,
}

impl Picture {
    pub fn at(&self, x: u32, y: u32) -> Vec3 {
        self.pixels[(y * self.size.x + x) as usize].into()
    }

    /// The pixel in the middle.
    pub fn center(&self) -> Vec3 {
        self.at(self.size.x / 2, self.size.y / 2)
    }

    /// Every pixel with its position.
    pub fn iter(&self) -> impl Iterator<Item = (UVec2, Vec3)> {
        let width = self.size.x;
        self.pixels.iter().enumerate().map(move |(i, p)| (UVec2::new(i as u32 % width, i as u32 / width), (*p).into()))
    }

    /// The mean of all channels of all pixels.
    pub fn mean(&self) -> f64 {
        self.iter().map(|(_, p)| f64::from(p.element_sum()) / 3.0).sum::<f64>() / self.pixels.len() as f64
    }

    /// The mean of pictures, which count as one sample each.
    pub fn mean_of(pictures: impl IntoIterator<Item = Self>) -> Self {
        let mut pictures = pictures.into_iter();
        let mut mean = pictures.next().expect("there is a picture");
        mean.samples = 1;
        for picture in pictures {
            mean.pixels.iter_mut().zip(picture.pixels).for_each(|(sum, pixel)| {
                *sum = (Vec3::from(*sum) + Vec3::from(pixel)).into();
            });
            mean.samples += 1;
        }
        let scale = 1.0 / mean.samples as f32;
        mean.pixels.iter_mut().for_each(|pixel| *pixel = (Vec3::from(*pixel) * scale).into());
        mean
    }

    pub fn is_finite(&self) -> bool {
        self.iter().all(|(_, p)| p.is_finite())
    }

    /// Whether the 3 x 3 pixels around a position have one value, so that no silhouette is near.
    pub fn is_flat_around(&self, at: UVec2) -> bool {
        let value = self.at(at.x, at.y);
        let near = |c: u32, size: u32| c.saturating_sub(1)..=(c + 1).min(size - 1);
        near(at.y, self.size.y).all(|y| near(at.x, self.size.x).all(|x| self.at(x, y) == value))
    }
}
