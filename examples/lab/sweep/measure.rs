//! Measures one configuration.

use bevy::{
    math::{UVec2, Vec3},
    transform::components::Transform,
};
use bevy_restir::{DebugView, Preset, Restir};
use bevy_restir_support::progress::Progress;
use serde::{Deserialize, Serialize};

use super::plan::{self, Configuration};
use crate::{
    bench::{Bench, Cost},
    blocks::{self, Block},
    difference::{Difference, relative_weight},
    error::{Picture, Reference, mean},
};

/// Frames that measure the speed of the machine.
const YARDSTICK: u32 = 12;
/// How often times are measured; the shortest ones count.
const ROUNDS: u32 = 2;
/// Sideways motion of the camera in a frame, relative to the median depth of the picture.
const STEP: f32 = 0.004;

/// Errors of a picture, means over the runs.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Errors {
    /// Mean squared error relative to the squared mean of the reference.
    pub mse: f64,
    pub rel_mse: f64,
    pub rel_mse_trimmed: f64,
    pub mape: f64,
    pub flip: f64,
    pub black: f64,
}

/// Figures under a moving camera.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Moving {
    pub errors: Errors,
    pub flicker: f64,
}

/// Measurements of a configuration.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// Names of lighting passes and their milliseconds.
    pub passes: Vec<(String, f64)>,
    /// Whether times are GPU times; otherwise they are CPU times.
    pub has_gpu_times: bool,
    /// Milliseconds of a sample of the reference tracer just before and after, by which the speed of the machine is known.
    pub yardstick: f64,
    /// How often times were measured.
    pub rounds: u32,
    pub rays_a_pixel: f64,
    pub reservoir_bytes_a_pixel: u64,
    /// All buffers and textures.
    pub bytes: u64,
    /// Numbers of captured frames, counted from 0, and their errors.
    pub frames: Vec<(u32, Errors)>,
    /// Relative difference of the mean, and its standard error over the runs.
    pub bias: f64,
    pub bias_error: f64,
    /// Root mean square of the bias of blocks, relative to the reference, without the part that the variances of the runs and of the
    /// reference explain.
    pub block_bias: f64,
    /// Variance between the runs, relative to the reference as relMSE is.
    pub variance: f64,
    /// Mean squared change of the error from one frame to the next, relative to the reference as relMSE is.
    pub flicker: f64,
    pub moving: Option<Moving>,
}

impl Record {
    /// Scales all times.
    pub fn scale_times(&mut self, factor: f64) {
        self.passes.iter_mut().for_each(|pass| pass.1 *= factor);
        self.yardstick *= factor;
    }

    /// Whether times were measured as often as they must be.
    pub fn is_timed(&self) -> bool {
        self.rounds >= ROUNDS
    }

    /// Milliseconds of all lighting passes.
    pub fn lighting(&self) -> f64 {
        self.passes.iter().map(|p| p.1).sum()
    }

    /// Errors of the frame after the history, which is the second-to-last captured frame.
    pub fn late(&self) -> Errors {
        let last = self.frames.len().saturating_sub(2);
        self.frames.get(last).map(|f| f.1).unwrap_or_default()
    }
}

/// The converged pictures that all configurations are compared with.
pub struct Truth {
    pub still: Picture,
    /// From the second-to-last position of the moving camera.
    pub before: Picture,
    pub figures: TruthFigures,
    /// Transform of the camera.
    place: Transform,
}

/// Figures of a converged picture.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct TruthFigures {
    /// Relative squared error of the picture itself.
    pub noise: f64,
    /// Samples a pixel.
    pub samples: u32,
    /// Motion of the camera in a frame, m.
    step: [f32; 3],
    /// Standard error of the picture's mean, relative to it.
    #[serde(default)]
    mean_error: f64,
    /// Mean of the variances of blocks, relative to the picture as relMSE is.
    #[serde(default)]
    block_noise: f64,
}

impl Truth {
    /// A picture from a file, for a camera that rests.
    pub fn given(bench: &Bench, still: Picture) -> Self {
        Self::kept(bench, still, Vec::new(), TruthFigures::default())
    }

    /// Pictures that were rendered before, for this camera.
    pub fn kept(bench: &Bench, still: Picture, before: Picture, figures: TruthFigures) -> Self {
        Self { still, before, figures, place: bench.place() }
    }

    /// Places of a camera that moves sideways and ends where it stands.
    fn motion(&self, frames: u32) -> Vec<Transform> {
        let step = Vec3::from(self.figures.step);
        let at = |left: u32| self.place.with_translation(self.place.translation - step * left as f32);
        (0..frames).rev().map(at).collect()
    }
}

/// How configurations are measured: frames, seeds and size of the runs.
pub struct Protocol<'a> {
    pub truth: &'a Truth,
    pub size: UVec2,
    pub seeds: u32,
    /// Number of frames before the one whose error counts.
    pub history: u32,
}

impl Protocol<'_> {
    /// The captured frames: 0, 1, 2, 4 ..., the last one and one more.
    fn captured(&self) -> Vec<u32> {
        let powers = core::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < self.history);
        core::iter::once(0).chain(powers).chain([self.history, self.history + 1]).collect()
    }

    /// Number of frames that a configuration takes.
    pub fn planned(&self, configuration: &Configuration) -> u64 {
        let runs = if configuration.moves { 2 } else { 1 };
        runs * u64::from(self.seeds) * u64::from(self.history + 2) + 2 * u64::from(YARDSTICK + 1)
    }

    /// Number of frames of [`Self::time_again`].
    pub fn planned_again(&self) -> u64 {
        u64::from(self.history + 2) + 2 * u64::from(YARDSTICK + 1)
    }

    /// Milliseconds of a sample of the reference tracer.
    fn yardstick(&self, bench: &mut Bench, shared: &[String], progress: &Progress) -> Result<f64, String> {
        let settings = plan::reference(Preset::Balanced).settings(shared)?;
        Ok(bench.show(&settings, YARDSTICK, progress)?.1)
    }

    /// Measures the times of a configuration once more, and keeps the shorter ones.
    pub fn time_again(
        &self,
        bench: &mut Bench,
        configuration: &Configuration,
        shared: &[String],
        record: &mut Record,
        progress: &Progress,
    ) -> Result<(), String> {
        let settings = configuration.settings(shared)?;
        let before = self.yardstick(bench, shared, progress)?;
        let (_, cost) = bench.runs(&settings, 1, &[self.history + 1], progress)?;
        let yardstick = 0.5 * (before + self.yardstick(bench, shared, progress)?);
        let passes = passes(&cost);
        let lighting: f64 = passes.iter().map(|pass| pass.1).sum();
        if lighting / yardstick < record.lighting() / record.yardstick {
            (record.passes, record.yardstick) = (passes, yardstick);
        }
        record.rounds += 1;
        Ok(())
    }

    /// Measures a configuration.  Also returns the picture after the history, of the first run.
    pub fn run(
        &self,
        bench: &mut Bench,
        configuration: &Configuration,
        shared: &[String],
        progress: &Progress,
    ) -> Result<(Record, Picture), String> {
        let settings = configuration.settings(shared)?;
        let captured = self.captured();
        let before = self.yardstick(bench, shared, progress)?;
        let (runs, cost) = bench.runs(&settings, self.seeds, &captured, progress)?;
        let reservoir_bytes_a_pixel = bench.report().reservoir_bytes_per_pixel;
        let bytes = bench.bytes();
        let yardstick = 0.5 * (before + self.yardstick(bench, shared, progress)?);
        let still = &self.truth.still;
        let frames: Vec<(u32, Errors)> = captured
            .iter()
            .enumerate()
            .map(|(i, &frame)| (frame, self.errors(runs.iter().map(|run| &run[i]))))
            .collect();
        let late: Vec<&Picture> = runs.iter().map(|run| &run[captured.len() - 2]).collect();
        let spread = Spread::new(&late, self.truth, self.size);
        let flicker = flicker(&runs, [still, still]);
        let moving = configuration.moves.then(|| self.moving(bench, &settings, progress)).transpose()?;
        let record = Record {
            passes: passes(&cost),
            has_gpu_times: cost.has_gpu_times,
            yardstick,
            rounds: 1,
            rays_a_pixel: cost.rays,
            reservoir_bytes_a_pixel,
            bytes,
            frames,
            bias: spread.bias,
            bias_error: spread.bias_error,
            block_bias: spread.block_bias,
            variance: spread.variance,
            flicker,
            moving,
        };
        Ok((record, late[0].clone()))
    }

    fn moving(&self, bench: &mut Bench, settings: &Restir, progress: &Progress) -> Result<Moving, String> {
        let last = self.history + 1;
        bench.set_motion(self.truth.motion(last + 1));
        let runs = bench.runs(settings, self.seeds, &[last - 1, last], progress);
        bench.set_motion(self.truth.motion(1));
        let (runs, _) = runs?;
        let errors = self.errors(runs.iter().map(|run| &run[1]));
        Ok(Moving { errors, flicker: flicker(&runs, [&self.truth.before, &self.truth.still]) })
    }

    fn errors<'p>(&self, pictures: impl Iterator<Item = &'p Picture>) -> Errors {
        let still = &self.truth.still;
        let scale = mean(still, |c| c).powi(2).max(f64::MIN_POSITIVE);
        let mut sum = Errors::default();
        for picture in pictures {
            let d = Difference::new(picture.clone(), still, self.size, blocks::SIDE);
            sum.mse += d.rmse.powi(2) / scale;
            sum.rel_mse += d.rel_mse;
            sum.rel_mse_trimmed += d.rel_mse_trimmed;
            sum.mape += d.mape;
            sum.flip += d.flip;
            sum.black += d.black;
        }
        let n = f64::from(self.seeds);
        let Errors { mse, rel_mse, rel_mse_trimmed, mape, flip, black } = sum;
        Errors {
            mse: mse / n,
            rel_mse: rel_mse / n,
            rel_mse_trimmed: rel_mse_trimmed / n,
            mape: mape / n,
            flip: flip / n,
            black: black / n,
        }
    }
}

/// Names and milliseconds of lighting passes.
fn passes(cost: &Cost) -> Vec<(String, f64)> {
    cost.of_passes().map(|(name, ms)| (name.into(), ms)).collect()
}

/// Renders the converged picture, with as many samples as `error` demands and at most `most`, and that of the place before.
pub fn truth(bench: &mut Bench, shared: &[String], error: f64, most: u32) -> Result<Truth, String> {
    /// Samples from which the necessary number is estimated.
    const PILOT: u32 = 64;
    let settings = plan::reference(Preset::Unbiased).settings(shared)?;
    let step = bench.place().right() * (STEP * depth(bench, &settings)?);
    let pilot = bench.reference(&settings, PILOT.min(most), &Progress::hidden())?;
    let needed = f64::from(PILOT) * relative_noise(&pilot) / error;
    let samples = (needed.ceil() as u32).clamp(PILOT.min(most), most).next_multiple_of(2);
    let progress = Progress::new(2 * u64::from(samples));
    let still = bench.reference(&settings, samples, &progress)?;
    let figures = TruthFigures {
        noise: relative_noise(&still),
        samples,
        step: step.into(),
        mean_error: mean_error(&still),
        block_noise: block_noise(&still, bench.size()),
    };
    let mut truth = Truth::kept(bench, still.pixels().clone(), Vec::new(), figures);
    bench.set_motion(truth.motion(2)[..1].into());
    truth.before = bench.reference(&settings, samples, &progress)?.pixels().clone();
    bench.set_motion(truth.motion(1));
    Ok(truth)
}

/// Median distance of what the camera sees, m.
fn depth(bench: &mut Bench, settings: &Restir) -> Result<f32, String> {
    let view = Restir { debug_view: DebugView::Depth, ..settings.clone() };
    let (picture, _) = bench.show(&view, 0, &Progress::hidden())?;
    let mut depths: Vec<f64> = picture.iter().map(|pixel| pixel[0]).filter(|d| *d > 0.0 && d.is_finite()).collect();
    depths.sort_by(f64::total_cmp);
    Ok(depths.get(depths.len() / 2).map_or(1.0, |d| *d as f32))
}

/// The squared error of a reference itself, relative to its pixels.
fn relative_noise(reference: &Reference) -> f64 {
    let pixels = reference.pixels();
    let average = mean(pixels, |c| c);
    let terms = pixels.iter().flatten().zip(reference.deviations().iter().flatten());
    terms.map(|(r, deviation)| deviation.powi(2) * relative_weight(*r, average)).sum::<f64>()
        / (3 * pixels.len()) as f64
}

/// Variances of the means over the channels of each pixel.  The channels have the same paths, so their errors are not independent.
fn of_pixels(reference: &Reference) -> impl Iterator<Item = f64> + '_ {
    reference.deviations().iter().map(|channels| (channels.iter().sum::<f64>() / 3.0).powi(2))
}

/// Standard error of the mean over pixels and channels, relative to it.
fn mean_error(reference: &Reference) -> f64 {
    let pixels = reference.pixels();
    of_pixels(reference).sum::<f64>().sqrt() / pixels.len() as f64 / mean(pixels, |c| c)
}

/// Mean over blocks of the variance of a block's mean, relative to the block.
fn block_noise(reference: &Reference, size: UVec2) -> f64 {
    let scale = mean(reference.pixels(), |c| c);
    let as_picture: Picture = of_pixels(reference).map(|variance| [variance; 3]).collect();
    // Independent errors of pixels: the variance of their mean is the mean variance over their number.
    let noise = blocks_of(&as_picture, size).into_iter().map(|block| block.mean / block.pixels);
    let truths = blocks_of(reference.pixels(), size);
    let relative = noise.zip(truths).map(|(noise, r)| noise * relative_weight(r.mean, scale));
    let all: Vec<f64> = relative.collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// Mean squared change of the error between the last two pictures of each run.
fn flicker(runs: &[Vec<Picture>], truths: [&Picture; 2]) -> f64 {
    let scale = mean(truths[1], |c| c);
    let mut sum = 0.0;
    for run in runs {
        let [a, b] = [&run[run.len() - 2], &run[run.len() - 1]];
        let errors = a.iter().zip(truths[0]).zip(b.iter().zip(truths[1]));
        for ((a, r), (b, s)) in errors {
            sum += (0..3).map(|i| ((b[i] - s[i]) - (a[i] - r[i])).powi(2) * relative_weight(s[i], scale)).sum::<f64>();
        }
    }
    sum / (3 * runs.len() * truths[1].len()) as f64
}

/// Bias and variance, apart.
struct Spread {
    bias: f64,
    bias_error: f64,
    block_bias: f64,
    variance: f64,
}

impl Spread {
    fn new(pictures: &[&Picture], truth: &Truth, size: UVec2) -> Self {
        let TruthFigures { mean_error, block_noise, .. } = truth.figures;
        let truth = &truth.still;
        let scale = mean(truth, |c| c);
        let means: Vec<f64> = pictures.iter().map(|p| mean(p, |c| c) / scale - 1.0).collect();
        let (bias, bias_variance) = moments(&means);
        let mut variance = 0.0;
        for (pixel, r) in truth.iter().enumerate() {
            for channel in 0..3 {
                let values: Vec<f64> = pictures.iter().map(|p| p[pixel][channel]).collect();
                variance += moments(&values).1 * relative_weight(r[channel], scale);
            }
        }
        let of_blocks: Vec<Vec<Block>> = pictures.iter().map(|p| blocks_of(p, size)).collect();
        let truths = blocks_of(truth, size);
        let mut squares = 0.0;
        for (i, r) in truths.iter().enumerate() {
            let values: Vec<f64> = of_blocks.iter().map(|blocks| blocks[i].mean).collect();
            let (average, spread) = moments(&values);
            squares += ((average - r.mean).powi(2) - spread / values.len() as f64) * relative_weight(r.mean, scale);
        }
        Self {
            bias,
            bias_error: (bias_variance / means.len() as f64 + mean_error.powi(2)).sqrt(),
            block_bias: (squares / truths.len() as f64 - block_noise).max(0.0).sqrt(),
            variance: variance / (3 * truth.len()) as f64,
        }
    }
}

/// Mean, and variance of one value.
fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let average = values.iter().sum::<f64>() / n;
    (average, values.iter().map(|v| (v - average).powi(2)).sum::<f64>() / (n - 1.0))
}

/// The blocks of a picture, with means over all channels.
fn blocks_of(picture: &Picture, size: UVec2) -> Vec<Block> {
    let values = picture.iter().map(|pixel| pixel.iter().sum::<f64>() / 3.0);
    blocks::of(values, size.x as usize, blocks::SIDE)
}
