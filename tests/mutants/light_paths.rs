//! Mutants of light paths (their MIS weights, scattering, connections, and splats) and of scattering below surfaces.

use super::{Mutant, mutant};

const WEIGHTS: &[&str] = &["weights_of_bidirectional_techniques"];
const SCATTERING: &[&str] = &["light_paths_scatter"];
const REPLAY: &[&str] = &["light_paths_of_the_last_frame_are_replayed"];
const ROOM: &[&str] = &["light_paths_in_a_room_equal"];
const CAUSTICS: &[&str] = &["reused_caustics_equal"];
const ALONE: &[&str] = &["light_paths_alone"];
const OPEN: &[&str] = &["open_objects_absorb_no_light_from_infinity"];
const CONNECTED: &[&str] = &["connected_paths_return_unchanged_from_other_pixels"];
const COPIED: &[&str] = &["connected_paths_with_copied_weights_return_unchanged"];
const OF_SPLAT: &[&str] = &["a_reconnected_light_path_contributes_as_much_as_its_splat"];
const RECONNECTED: &[&str] = &["reconnected_light_paths_alone_find_all_light_of_a_diffuse_corner"];
const COUNTED: &[&str] = &["views_of_light_paths_count_those_that_are_seen"];
const BODIES: &[&str] = &["light_in_translucent_bodies_equals"];

pub const MUTANTS: &[Mutant] = &[
    // MIS weights.
    mutant(
        "arrival at a vertex lacks the distance",
        "path/bidirectional_mis.wgsl",
        "return MisState(s.last * distance2 / cos_in, s.earlier / cos_in);",
        "return MisState(s.last / cos_in, s.earlier / cos_in);",
        WEIGHTS,
    ),
    mutant(
        "the state after scattering is used in place of the one before",
        "path/bidirectional_mis.wgsl",
        "return mis_sum(s, pdf_reverse);",
        "return mis_sum(MisState(1.0 / pdf_forward, s.earlier), pdf_reverse);",
        WEIGHTS,
    ),
    mutant(
        "no ray hits an environment",
        "path/bidirectional_mis.wgsl",
        "select(1.0 / (light_density * emission_density), 0.0, is_delta)",
        "0.0",
        WEIGHTS,
    ),
    mutant(
        "the camera sees one light path",
        "path/bidirectional_mis.wgsl",
        "camera_density * cos_in / splats * mis_sum(light, pdf_reverse)",
        "camera_density * cos_in * mis_sum(light, pdf_reverse)",
        WEIGHTS,
    ),
    mutant(
        "the density back from a vertex that the camera sees is that of Eq. 40 as printed",
        "path/bidirectional_mis.wgsl",
        "camera_density * cos_in / splats * mis_sum(light, pdf_reverse)",
        "camera_density * cos_in / splats * mis_sum(light, camera_density * cos_in)",
        WEIGHTS,
    ),
    // Eq. 42 as printed has the cosine and the distance of the other direction.  A vertex does not know the distance to the one before;
    // `sampling::bidirectional_mis` plants the whole term.
    mutant(
        "earlier techniques of a camera path count the cosine of the other direction",
        "path/technique_weights.wgsl",
        "cos_out / step.pdf * sum, s.basis);",
        "abs(dot(v.surface.bsdf.n_geo, v.wo)) / step.pdf * sum, s.basis);",
        WEIGHTS,
    ),
    // Steps and samples of the BSDF have no probability of a delta lobe; `sampling::bidirectional_mis` plants those of its paths.
    mutant(
        "delta lobes of a camera path count a probability of one half in one direction",
        "path/technique_weights.wgsl",
        "return CameraState(vec3<f32>(0.0), cos_out * s.earlier, s.basis);",
        "return CameraState(vec3<f32>(0.0), 0.5 * cos_out * s.earlier, s.basis);",
        WEIGHTS,
    ),
    mutant(
        "delta lobes of a light path count a probability of one half in one direction",
        "path/bidirectional_mis.wgsl",
        "return MisState(0.0, cos_out * s.earlier);",
        "return MisState(0.0, 0.5 * cos_out * s.earlier);",
        WEIGHTS,
    ),
    mutant(
        "next-event estimation does not count light paths",
        "path/technique_weights.wgsl",
        "return emitted_density(l, counts.shares.nee) / nee * cosine * (s.last + s.earlier * reverse_pdf(v.surface, l.wi, v.wo));",
        "return vec3<f32>(0.0);",
        ROOM,
    ),
    mutant(
        "the density of camera rays ignores the scale of the camera",
        "view/camera.wgsl",
        "let pixel = camera.image_area / (f32(view.size.x) * f32(view.size.y));",
        "let pixel = 4.0 * abs(camera.view_from_clip[0].x * camera.view_from_clip[1].y) / (f32(view.size.x) * f32(view.size.y));",
        ALONE,
    ),
    mutant(
        "the camera never sees back faces",
        "trace/drawn_sides.wgsl",
        "let front = faces != ((view.flags & VIEW_SEES_BACK_FACES) != 0u);",
        "let front = faces;",
        ALONE,
    ),
    mutant(
        "culled sides hide light paths from the camera",
        "trace/drawn_sides.wgsl",
        "return !hits_drawn_sides() || is_drawn(instance, triangle, viewer_direction, viewer_is_previous);",
        "return true;",
        ALONE,
    ),
    mutant(
        "light paths that the camera sees count one light candidate",
        "restir/bdpt/splat.wgsl",
        "if w.events == 1u {",
        "if false {",
        ROOM,
    ),
    mutant(
        "an absorbing object ends behind an object inside of it",
        "path/medium.wgsl",
        "is_inside && max_component(medium) == 0.0",
        "false",
        &["a_clear_body_inside_of_an_absorbing_one"],
    ),
    mutant(
        "open objects absorb light from infinity",
        "path/medium.wgsl",
        "select(distance, 0.0, distance >= FAR)",
        "distance",
        OPEN,
    ),
    mutant(
        "open objects absorb light from infinity in light paths",
        "path/light_path.wgsl",
        "select(w.hit.t, 0.0, is_at_infinity(ray.light))",
        "w.hit.t",
        OPEN,
    ),
    // Walks from lights.
    mutant(
        "light paths scatter as paths from the camera that go the other way",
        "path/light_path.wgsl",
        "return bsdf_eval(s.bsdf, wo, towards_light) / arrival_cosine(s, towards_light);",
        "return bsdf_eval(s.bsdf, towards_light, wo) / arrival_cosine(s, towards_light);",
        SCATTERING,
    ),
    mutant(
        "light paths carry the radiance of smooth glass",
        "path/light_path.wgsl",
        "var value = b.weight * (b.eta * b.eta);",
        "var value = b.weight;",
        SCATTERING,
    ),
    mutant(
        "the other side of glass has the same index of refraction",
        "scene/lobes.wgsl",
        "s.eta = 1.0 / b.eta;",
        "",
        SCATTERING,
    ),
    mutant(
        "light that arrives by a light path lacks the cosine",
        "path/light_path.wgsl",
        "return bsdf_eval(s.bsdf, wo, towards_light) / arrival_cosine(s, towards_light);",
        "return bsdf_eval(s.bsdf, wo, towards_light);",
        &["light_paths_scatter", "light_paths_in_a_room_equal"],
    ),
    mutant(
        "the density of emitted rays lacks the distance",
        "path/light_path.wgsl",
        "emission_density /= d2;",
        "",
        ROOM,
    ),
    mutant(
        "light paths by glass and mirrors count like others",
        "restir/connection/light_sub_path.wgsl",
        "settings.caustic_share / settings.nee_share",
        "1.0",
        CAUSTICS,
    ),
    // Splats and connections.
    mutant(
        "the camera sees light paths without the cosine",
        "restir/bdpt/splat.wgsl",
        "splat_share(weight) * cosine * density",
        "splat_share(weight) * density",
        ROOM,
    ),
    mutant(
        "connections lack the cosine at the light path",
        "restir/connection/connection.wgsl",
        "path.radiance * (cosine / d2) * carried",
        "path.radiance * (1.0 / d2) * carried",
        ROOM,
    ),
    mutant(
        "a vertex of the cache stands for itself alone",
        "restir/pt/initial_candidates.wgsl",
        "f32(chosen.count) / light_pmf(chosen.light) * CONNECTION_SHARE",
        "1.0 / light_pmf(chosen.light) * CONNECTION_SHARE",
        ROOM,
    ),
    mutant(
        "a reconnected path stores the numbers of its connection's weight in the wrong order",
        "restir/connection/connection.wgsl",
        "path.mis_coefficients = k.mis_ratios;",
        "path.mis_coefficients = k.mis_ratios.yx;",
        CONNECTED,
    ),
    mutant(
        "paths store no MIS weight that shifts could copy",
        "restir/path_sample.wgsl",
        "path.mis_coefficients = vec2<f32>(weight, 0.0);",
        "path.mis_coefficients = vec2<f32>(1.0, 0.0);",
        COPIED,
    ),
    mutant(
        "a connection that is shifted loses its copied weight",
        "restir/shift/path_end.wgsl",
        "(*w).path = with_mis_of(with_connection(s, k), s);",
        "(*w).path = with_connection(s, k);",
        COPIED,
    ),
    mutant(
        "a light path that is traced again loses its copied weight",
        "restir/connection/connection.wgsl",
        "Retraced(with_mis_of(with_light_vertex(path, vertex), path), vertex.events > 0u)",
        "Retraced(with_light_vertex(path, vertex), vertex.events > 0u)",
        COPIED,
    ),
    mutant(
        "the report has the vertices in the cache, and not those that they stand for",
        "pass/light_path_counts.wgsl",
        "vertices_traced_by(pixel).y",
        "vertices_traced_by(pixel).x",
        COUNTED,
    ),
    mutant(
        "connections are weighed like light paths that the camera sees",
        "restir/connection/connection.wgsl",
        "mis_connection_ratios(end, abs(dot(x.bsdf.n_geo, k.wi)), d2, connections)",
        "mis_connection_ratios(end, abs(dot(x.bsdf.n_geo, k.wi)), d2, 1.0)",
        ROOM,
    ),
    mutant(
        "light paths of connections are traced again in this frame",
        "restir/shift/path_end.wgsl",
        "end = retraced(s, previous);",
        "end = retraced(s, false);",
        &["light_vertices_of_the_last_frame_are_found_in_its_scene"],
    ),
    mutant(
        "a connection keeps the light vertex of the other frame",
        "restir/shift/path_end.wgsl",
        "(*w).path = end.path;",
        "",
        &["connected_paths_store_the_light_vertices_of_this_frame"],
    ),
    mutant(
        "light paths of connections are traced again with the numbers of this frame",
        "restir/connection/connection.wgsl",
        "let frame = view.frame - ((view.frame - path.born) & 0xffffu);",
        "let frame = view.frame;",
        &["connected_paths_equal_the_reference_in_moving_scenes"],
    ),
    mutant(
        "the canonical sample's target in a neighbor's domain is divided by the Jacobian",
        "pass/reuse.wgsl",
        "value *= jacobian_of(e);",
        "value /= max(jacobian_of(e), 1.0e-30);",
        &["paths_in_a_room_equal", "connected_paths_equal_the_reference_in_moving_scenes"],
    ),
    mutant(
        "one light path stands for all that land in its pixel",
        "pass/splats.wgsl",
        "guarded(luminance(landed.sum) / max(luminance(r.f), LEAST_DIVISOR), GUARD_CONTRIBUTION_WEIGHT)",
        "1.0",
        CAUSTICS,
    ),
    mutant(
        "the number of events of a light path is read as one less",
        "restir/bdpt/light_map.wgsl",
        "(words[0] >> LINK_BITS) + 1u",
        "words[0] >> LINK_BITS",
        REPLAY,
    ),
    mutant(
        "reservoirs of light paths read a vertex too many",
        "restir/splats/reservoir.wgsl",
        "p.vertex >> 24u, p.light",
        "(p.vertex >> 24u) + 1u, p.light",
        REPLAY,
    ),
    // Reconnected light paths.
    mutant(
        "light paths are reconnected in the scene of this frame alone",
        "restir/reconnected/domain.wgsl",
        "replayed_sub_path(s.path, s.frame, s.light, s.events - 1u, r.previous)",
        "replayed_sub_path(s.path, s.frame, s.light, s.events - 1u, false)",
        RECONNECTED,
    ),
    mutant(
        "light paths that are reconnected pass through objects",
        "restir/reconnected/domain.wgsl",
        "return !trace_any(e.ray, e.alpha_seed, r.previous);",
        "return true;",
        &["reconnected_light_paths_do_not_pass_through_a_wall"],
    ),
    mutant(
        "light paths that are reconnected forget the weights of their first vertices",
        "restir/reconnected/domain.wgsl",
        "    t.state = w.state;\n",
        "",
        OF_SPLAT,
    ),
    mutant(
        "light paths that are reconnected count one connection in their MIS weight",
        "restir/reconnected/domain.wgsl",
        "    state.last *= connections_of_vertex();\n",
        "",
        OF_SPLAT,
    ),
    mutant(
        "light paths of the other domain are replayed, too",
        "restir/bdpt/splat.wgsl",
        "    if splat.reconnects {\n",
        "    if false {\n",
        &["light_paths_of_the_last_frame_stay_in_their_domain"],
    ),
    mutant(
        "light paths that are reconnected have the alpha seed of another event",
        "restir/connection/light_sub_path.wgsl",
        "rng.dimension += CAMERA_ALPHA_NUMBER - ALPHA_NUMBER - 1u;",
        "rng.dimension += CAMERA_ALPHA_NUMBER;",
        &["each_light_path_belongs_to_one_domain"],
    ),
    // Below surfaces.
    mutant(
        "the profile has twice its light",
        "subsurface/profile.wgsl",
        "(8.0 * PI * x)",
        "(4.0 * PI * x)",
        &["the_profile_and_its_inverse_equal"],
    ),
    mutant(
        "the tangents have the probability of the normal",
        "subsurface/probe.wgsl",
        "select(0.25, 0.5, axis == 0u)",
        "1.0 / 3.0",
        &["the_density_of_a_hit_equals"],
    ),
    mutant(
        "probes are longer than their reach",
        "subsurface/probe.wgsl",
        "d * sqrt(max(REACH * REACH - x * x, 0.0))",
        "d * REACH",
        &["probes_find_points_with_their_density"],
    ),
    mutant(
        "a probe with several hits finds each of them",
        "subsurface/entry.wgsl",
        "(f32(hits.count) / pdf)",
        "(1.0 / pdf)",
        &["bodies_are_what_an_independent_integral"],
    ),
    mutant(
        "going on below the surface has no probability",
        "path/scattering.wgsl",
        "exit_factor(v.surface, v.wo) / p);",
        "exit_factor(v.surface, v.wo));",
        &["paths_between_translucent_bodies"],
    ),
    mutant(
        "shifted paths draw other probes",
        "restir/shift/hybrid.wgsl",
        "let entry = replayed_entry(v, s.seed, index, previous);",
        "let entry = replayed_entry(v, s.seed + 1u, index, previous);",
        &["paths_through_translucent_bodies_return", "paths_between_translucent_bodies"],
    ),
    mutant(
        "points of entry lack the measure of their triangle",
        "restir/sss/domain.wgsl",
        "r.exit_factors * profile_per_area(r.surface.radius, distance) * area,",
        "r.exit_factors * profile_per_area(r.surface.radius, distance),",
        BODIES,
    ),
    mutant(
        "candidates below the surface have no probability of a channel",
        "restir/sss/initial_candidates.wgsl",
        "c.pmf * c.rounding * choice * p.density",
        "c.pmf * c.rounding * p.density",
        BODIES,
    ),
    mutant(
        "the Jacobian of a probe is that of the way back",
        "restir/sss/domain.wgsl",
        "return select(1.0, before / after, replays);",
        "return select(1.0, after / before, replays);",
        &["delayed_reconnection_has_the_jacobian"],
    ),
    mutant(
        "delayed reconnection keeps the cosine at the light",
        "restir/sss/domain.wgsl",
        "    let light = light_point_at(s.light, p.surface.position, r.previous);\n",
        "    var light = light_point_at(s.light, p.surface.position, r.previous);\n\
        let x2 = entry_point(r, Hit(0.0, s.instance, s.triangle, s.barycentrics)).surface.position;\n\
        let from_x2 = light_point_at(s.light, x2, r.previous);\n\
        light.pdf_solid_angle = from_x2.pdf_solid_angle * light.distance * light.distance;\n\
        light.pdf_solid_angle /= from_x2.distance * from_x2.distance;\n",
        &["light_in_bodies_returns_unchanged"],
    ),
];
