// Indirect light of ReSTIR PT, where direct light has reservoirs of its own: paths of at least two scattering events.  Functions that are not
// defined here are those of whole paths (`restir/pt/domain.wgsl`).
#define_import_path bevy_restir::restir::pt_indirect::domain

// Direct light, of paths one vertex shorter, is left to ReSTIR DI.
const SHORTEST_LENGTH: u32 = 3u;
