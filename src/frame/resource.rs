//! Group 2 of compute passes: creates layout and bind group from the list of resources that a pass declares.

use bevy::render::{render_resource::*, renderer::RenderDevice};

use crate::{
    technique::{
        domain::LightPart,
        frame::Step,
        pass::{ComputePass, PassResource as R},
    },
    view::{
        RestirView,
        bind_groups::Bound,
        denoiser::PACKED_FORMAT,
        history::{History, LIGHT_FORMAT, Reservoirs},
        pairs::PAIR_MASK_FORMAT,
    },
};

/// Binding of the counters (`shaders/view/counter_bindings.wgsl`), above those of all other resources.
pub const COUNTERS_BINDING: u32 = 15;

/// The resources of a pass with their bindings.
fn bindings(pass: &ComputePass) -> impl Iterator<Item = (u32, R)> {
    pass.resources.iter().zip(0..).map(|(&resource, place)| match resource {
        R::Counters => (COUNTERS_BINDING, resource),
        _ => (place, resource),
    })
}

/// Layout of a compute pass's group 2.
pub(super) fn layout(pass: &ComputePass) -> BindGroupLayoutDescriptor {
    let entries: Vec<_> = bindings(pass)
        .map(|(binding, resource)| BindGroupLayoutEntry {
            binding,
            visibility: ShaderStages::COMPUTE,
            ty: binding_type(resource),
            count: None,
        })
        .collect();
    BindGroupLayoutDescriptor::new(format!("restir {}", pass.name), &entries)
}

fn binding_type(resource: R) -> BindingType {
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let storage = |read_only| buffer(BufferBindingType::Storage { read_only });
    let texture_of =
        |sample_type, view_dimension| BindingType::Texture { sample_type, view_dimension, multisampled: false };
    let texture = |sample_type| texture_of(sample_type, TextureViewDimension::D2);
    let layers = |sample_type| texture_of(sample_type, TextureViewDimension::D2Array);
    let written = |format, view_dimension| BindingType::StorageTexture {
        access: StorageTextureAccess::WriteOnly,
        format,
        view_dimension,
    };
    match resource {
        R::Radiance | R::Counters | R::Subsets | R::CandidateReservoirs | R::OutputReservoirs => storage(false),
        R::LightMap | R::LastReservoirs | R::ForwardedReservoirs | R::ReplayQueue => storage(false),
        R::SubsetsRead | R::NeighborReservoirs | R::FinalReservoirs | R::LastReservoirsRead => storage(true),
        R::LightMapRead | R::ReplayQueueRead => storage(true),
        R::Settings => buffer(BufferBindingType::Uniform),
        R::PreviousVisibility | R::PairMasksRead | R::GuideRead | R::LastGuide => texture(TextureSampleType::Uint),
        R::OpticalImagesRead | R::LastOpticalImages | R::LightVerticesRead => texture(TextureSampleType::Uint),
        R::LightBefore
        | R::UnresampledLightRead
        | R::DirectLight
        | R::SubsurfaceLight
        | R::PathLight
        | R::ImagePlacesRead
        | R::SplatLight
        | R::ReconnectedLight => texture(TextureSampleType::Float { filterable: false }),
        R::PairShiftsRead | R::SignalsBefore => layers(TextureSampleType::Float { filterable: false }),
        R::LastMeans => layers(TextureSampleType::Uint),
        R::CandidateLight | R::LightAfter | R::UnresampledLight | R::ImagePlaces => {
            written(LIGHT_FORMAT, TextureViewDimension::D2)
        }
        R::DenoiserSettings => buffer(BufferBindingType::Uniform),
        R::SignalsAfter => written(LIGHT_FORMAT, TextureViewDimension::D2Array),
        R::Guide | R::OpticalImages | R::LightVertices => written(PACKED_FORMAT, TextureViewDimension::D2),
        R::Means => written(PACKED_FORMAT, TextureViewDimension::D2Array),
        R::PairMasks => written(PAIR_MASK_FORMAT, TextureViewDimension::D2),
        R::PairShifts => written(LIGHT_FORMAT, TextureViewDimension::D2Array),
    }
}

/// Group 2 of a step; `None` while one of its resources does not exist yet.
pub(super) fn bind_group(
    pass: &ComputePass,
    step: &Step,
    state: &RestirView,
    device: &RenderDevice,
    pipelines: &PipelineCache,
) -> Option<BindGroup> {
    let bound: Vec<Bound> =
        pass.resources.iter().map(|&resource| binding_of(resource, step, state)).collect::<Option<_>>()?;
    Some(state.bind_groups.get(pass.name, &bound, || {
        let entries = bound.iter().zip(bindings(pass));
        let entries: Vec<_> =
            entries.map(|(bound, (binding, _))| BindGroupEntry { binding, resource: bound.resource() }).collect();
        device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&layout(pass)), &entries)
    }))
}

fn binding_of<'a>(resource: R, step: &Step, state: &'a RestirView) -> Option<Bound<'a>> {
    let history = state.history.as_ref();
    let own = || history?.of(step.domain?);
    let (view, buffer) = (Bound::View, Bound::Buffer);
    let light_paths = || history?.light_paths.as_ref();
    let denoiser = || history?.denoiser.as_ref();
    Some(match resource {
        R::Radiance => buffer(&state.radiance),
        R::Counters => buffer(&state.counters.buffer),
        R::Settings => own()?.settings_of(step.iteration)?,
        R::Subsets | R::SubsetsRead => buffer(&history?.subsets),
        R::CandidateReservoirs => buffer(own()?.candidates()),
        R::NeighborReservoirs => buffer(own()?.neighbors_of(step.iteration)),
        R::OutputReservoirs => buffer(own()?.output_of(step.iteration)),
        R::LastReservoirs | R::LastReservoirsRead => buffer(own()?.last_frame()),
        R::ForwardedReservoirs => buffer(own()?.forwarded()?),
        R::FinalReservoirs => buffer(own()?.final_output()),
        R::LightVertices | R::LightVerticesRead => view(&light_paths()?.vertices),
        R::LightMap | R::LightMapRead => buffer(&light_paths()?.map),
        R::SplatLight => view(light_of(history?, LightPart::Splats)),
        R::ReconnectedLight => view(light_of(history?, LightPart::Reconnected)),
        R::PairMasks | R::PairMasksRead => view(&history?.pairs.as_ref()?.masks),
        R::PairShifts | R::PairShiftsRead => view(&history?.pairs.as_ref()?.shifts),
        R::ReplayQueue | R::ReplayQueueRead => buffer(&history?.pairs.as_ref()?.queue.as_ref()?.0),
        R::DenoiserSettings => denoiser()?.settings_of(step.iteration)?,
        R::SignalsAfter => view(denoiser()?.signals_after(step.iteration)),
        R::SignalsBefore => view(denoiser()?.signals_before(step.iteration)),
        R::Guide | R::GuideRead => view(denoiser()?.guides()[0]),
        R::LastGuide => view(denoiser()?.guides()[1]),
        R::OpticalImages | R::OpticalImagesRead => view(denoiser()?.optical_images()[0]),
        R::LastOpticalImages => view(denoiser()?.optical_images()[1]),
        R::ImagePlaces => view(denoiser()?.image_places()?),
        R::ImagePlacesRead => view(denoiser()?.image_places().unwrap_or(&history?.black)),
        R::Means => view(denoiser()?.means()[0]),
        R::LastMeans => view(denoiser()?.means()[1]),
        R::PreviousVisibility => view(&history?.previous_visibility),
        R::CandidateLight => view(own()?.light_before(0)),
        R::LightBefore => view(own()?.light_before(step.iteration)),
        R::LightAfter => view(own()?.light_after(step.iteration)),
        R::UnresampledLight => view(own()?.unresampled.as_ref()?),
        R::UnresampledLightRead => {
            let unresampled = history?.reservoirs().iter().find_map(|r| r.unresampled.as_ref());
            view(unresampled.unwrap_or(&history?.black))
        }
        R::DirectLight => view(light_of(history?, LightPart::Direct)),
        R::SubsurfaceLight => view(light_of(history?, LightPart::Subsurface)),
        R::PathLight => view(light_of(history?, LightPart::Paths)),
    })
}

/// Light of the frame's domain for this part; black if the frame has none.
fn light_of(history: &History, part: LightPart) -> &TextureView {
    let mut domains = history.reservoirs().iter();
    domains.find(|r| r.domain().part == part).map_or(&history.black, Reservoirs::light_of_last_iteration)
}
