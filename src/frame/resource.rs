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
        history::{History, LIGHT_FORMAT, Reservoirs},
    },
};

/// Layout of a compute pass's group 2.
pub(super) fn layout(pass: &ComputePass) -> BindGroupLayoutDescriptor {
    let entries: Vec<_> = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, &resource)| BindGroupLayoutEntry {
            binding: binding as u32,
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
    let texture = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    match resource {
        R::Radiance | R::Counters | R::Subsets | R::CandidateReservoirs | R::OutputReservoirs => storage(false),
        R::LightVertices | R::LightMap | R::LastReservoirs | R::ForwardedReservoirs => storage(false),
        R::SubsetsRead | R::NeighborReservoirs | R::FinalReservoirs | R::LastReservoirsRead => storage(true),
        R::LightVerticesRead | R::LightMapRead => storage(true),
        R::Settings => buffer(BufferBindingType::Uniform),
        R::PreviousVisibility => texture(TextureSampleType::Uint),
        R::LightBefore
        | R::UnresampledLight
        | R::ResampledLight
        | R::SubsurfaceLight
        | R::PathLight
        | R::ConnectionsRead
        | R::SplatLight => texture(TextureSampleType::Float { filterable: false }),
        R::CandidateLight | R::LightAfter | R::Connections => BindingType::StorageTexture {
            access: StorageTextureAccess::WriteOnly,
            format: LIGHT_FORMAT,
            view_dimension: TextureViewDimension::D2,
        },
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
    let entries = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, &resource)| {
            Some(BindGroupEntry { binding: binding as u32, resource: binding_of(resource, step, state)? })
        })
        .collect::<Option<Vec<_>>>()?;
    Some(device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&layout(pass)), &entries))
}

fn binding_of<'a>(resource: R, step: &Step, state: &'a RestirView) -> Option<BindingResource<'a>> {
    let history = state.history.as_ref();
    let own = || history?.of(step.domain?);
    let view = BindingResource::TextureView;
    let light_paths = || history?.light_paths.as_ref();
    Some(match resource {
        R::Radiance => state.radiance.as_entire_binding(),
        R::Counters => state.counters.buffer.as_entire_binding(),
        R::Settings => own()?.settings_of(step.iteration),
        R::Subsets | R::SubsetsRead => history?.subsets.as_entire_binding(),
        R::CandidateReservoirs => own()?.candidates()?.as_entire_binding(),
        R::NeighborReservoirs => own()?.neighbors_of(step.iteration)?.as_entire_binding(),
        R::OutputReservoirs => own()?.output_of(step.iteration)?.as_entire_binding(),
        R::LastReservoirs | R::LastReservoirsRead => own()?.last_frame()?.as_entire_binding(),
        R::ForwardedReservoirs => own()?.forwarded()?.as_entire_binding(),
        R::FinalReservoirs => own()?.last_output()?.as_entire_binding(),
        R::LightVertices | R::LightVerticesRead => light_paths()?.vertices.as_entire_binding(),
        R::LightMap | R::LightMapRead => light_paths()?.map.as_entire_binding(),
        R::Connections => view(light_paths()?.connections.as_ref()?),
        R::ConnectionsRead => {
            let connections = light_paths().and_then(|paths| paths.connections.as_ref());
            view(connections.unwrap_or(&history?.black))
        }
        R::SplatLight => view(light_of(history?, LightPart::LightPaths, Reservoirs::light_of_last_iteration)),
        R::PreviousVisibility => view(&history?.previous_visibility_view),
        R::CandidateLight => view(own()?.light_of_candidates()),
        R::LightBefore => view(own()?.light_before(step.iteration)),
        R::LightAfter => view(own()?.light_after(step.iteration)),
        R::UnresampledLight => view(light_of(history?, LightPart::Direct, Reservoirs::light_of_candidates)),
        R::ResampledLight => view(light_of(history?, LightPart::Direct, Reservoirs::light_of_last_iteration)),
        R::SubsurfaceLight => view(light_of(history?, LightPart::Subsurface, Reservoirs::light_of_last_iteration)),
        R::PathLight => view(light_of(history?, LightPart::Paths, Reservoirs::light_of_last_iteration)),
    })
}

/// Light of the frame's domain for this part; black if the frame has none.
fn light_of(history: &History, part: LightPart, of: fn(&Reservoirs) -> &TextureView) -> &TextureView {
    let mut domains = history.reservoirs().iter();
    domains.find(|r| r.domain().part == part).map_or(&history.black, of)
}
