// Refits the tree of a body: the tree keeps its topology from the rest pose, and its boxes follow the triangles.  A box encloses its triangles
// of this frame and of the last one, so that one tree serves rays through both.
#define_import_path bevy_restir::deformation::refit

#import bevy_restir::common::constants::FAR
#import bevy_restir::deformation::bindings::{boxes, nodes, rigs, triangles, vertices}
#import bevy_restir::deformation::types::Body
#import bevy_restir::scene::types::Triangle

struct Box {
    low: vec3<f32>,
    high: vec3<f32>,
}

fn joined(x: Box, y: Box) -> Box {
    return Box(min(x.low, y.low), max(x.high, y.high));
}

fn box_of(t: Triangle) -> Box {
    let a = vertices[t.a].position;
    let b = vertices[t.b].position;
    let c = vertices[t.c].position;
    return Box(min(a, min(b, c)), max(a, max(b, c)));
}

// Indices in `rigs` where the nodes of a level begin and end.  The table `levels` holds these indices for all levels, relative to its own
// start, followed by the nodes.  Level 0 is the deepest.
fn nodes_of_level(body: Body, level: u32) -> vec2<u32> {
    return vec2<u32>(body.levels + rigs[body.levels + level], body.levels + rigs[body.levels + level + 1u]);
}

fn node_at(place: u32) -> u32 {
    return rigs[place];
}

// A node of 5 words (`trace/tree.wgsl`).  Links to children and triangles are those of the tree at rest, moved to this body.
fn refit_node(body: Body, node: u32) {
    let rest = (body.rest_node + node) * 5u;
    let inner = nodes[rest].w >> 24u;
    let links = nodes[rest + 1u];
    let first_child = links.x - body.rest_node;
    let first_triangle = links.y - body.rest_triangle;
    let nothing = Box(vec3<f32>(FAR), vec3<f32>(-FAR));
    var children: array<Box, 8>;
    var whole = nothing;
    for (var slot = 0u; slot < 8u; slot += 1u) {
        children[slot] = nothing;
        let code = (select(links.z, links.w, slot >= 4u) >> (8u * (slot & 3u))) & 0xffu;
        if (inner & (1u << slot)) != 0u {
            let child = body.first_box + 2u * (first_child + countOneBits(inner & ((1u << slot) - 1u)));
            children[slot] = Box(boxes[child].xyz, boxes[child + 1u].xyz);
        } else {
            for (var i = 0u; i < countOneBits(code >> 5u); i += 1u) {
                let triangle = body.triangle + first_triangle + (code & 31u) + i;
                let both = joined(box_of(triangles[triangle]), box_of(triangles[triangle + body.triangle_count]));
                children[slot] = joined(children[slot], both);
            }
        }
        whole = joined(whole, children[slot]);
    }
    boxes[body.first_box + 2u * node] = vec4<f32>(whole.low, 0.0);
    boxes[body.first_box + 2u * node + 1u] = vec4<f32>(whole.high, 0.0);

    // Planes of children are whole.low + q·cell, where q has 8 bits and the cell is a power of two.
    let extent = bitcast<vec3<u32>>((whole.high - whole.low) / 255.0);
    let is_rounded_up = (extent & vec3<u32>(0x7fffffu)) != vec3<u32>(0u);
    let exponent = max((extent >> vec3<u32>(23u)) + select(vec3<u32>(0u), vec3<u32>(1u), is_rounded_up), vec3<u32>(1u));
    let cell = bitcast<vec3<f32>>(exponent << vec3<u32>(23u));
    // For each axis: eight low planes in two words, then eight high ones.
    var planes: array<u32, 12>;
    for (var slot = 0u; slot < 8u; slot += 1u) {
        let low = vec3<u32>(clamp(floor((children[slot].low - whole.low) / cell), vec3<f32>(0.0), vec3<f32>(255.0)));
        let high = vec3<u32>(clamp(ceil((children[slot].high - whole.low) / cell), vec3<f32>(0.0), vec3<f32>(255.0)));
        let shift = 8u * (slot & 3u);
        for (var axis = 0u; axis < 3u; axis += 1u) {
            planes[4u * axis + (slot >> 2u)] |= low[axis] << shift;
            planes[4u * axis + (slot >> 2u) + 2u] |= high[axis] << shift;
        }
    }
    let at = (body.node + node) * 5u;
    nodes[at] = vec4<u32>(bitcast<vec3<u32>>(whole.low), exponent.x | (exponent.y << 8u) | (exponent.z << 16u) | (inner << 24u));
    nodes[at + 1u] = vec4<u32>(body.node + first_child, body.triangle + first_triangle, links.zw);
    for (var axis = 0u; axis < 3u; axis += 1u) {
        let first = 4u * axis;
        nodes[at + 2u + axis] = vec4<u32>(planes[first], planes[first + 1u], planes[first + 2u], planes[first + 3u]);
    }
}
