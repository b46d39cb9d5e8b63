// The BSDF: value, sample and density, of the sum of all lobes and of single lobes.  The model is that of glTF 2.0 (Appendix B and the KHR
// extensions): a base of LOBE_DIFFUSE + LOBE_REFLECTION + LOBE_TRANSMISSION, whose microfacets share one α, under LOBE_COAT.  Delta lobes
// are sampled, but never evaluated.
#define_import_path bevy_restir::bsdf::bsdf

#import bevy_restir::bsdf::coat::{coat_draw, coat_eval, coat_is_chosen, coat_is_rough, coat_pdf, coat_share}
#import bevy_restir::bsdf::diffuse::{diffuse_albedo, diffuse_eval, diffuse_pdf, diffuse_sample}
#import bevy_restir::bsdf::ggx::{ggx_masking_ratio, ggx_sample}
#import bevy_restir::bsdf::lobe_choice::{is_specular, lobe_choice, reflection_probability}
#import bevy_restir::bsdf::reflection::{reflectance, reflection_eval, reflection_pdf, reflection_sample}
#import bevy_restir::bsdf::roughness::{alpha_of, frame_of}
#import bevy_restir::bsdf::transmission::{transmission_cosine, transmission_eval, transmission_is_delta, transmission_pdf, transmission_sample, transmitted_share}
#import bevy_restir::bsdf::types::{Bsdf, BsdfSample, LOBE_COAT, LOBE_DIFFUSE, LOBE_REFLECTION, LOBE_TRANSMISSION, no_bsdf_sample}
#import bevy_restir::common::constants::{ALPHA_DELTA, ONE_MINUS_EPSILON}
#import bevy_restir::common::guard::{GUARD_BSDF_SAMPLE, guard_holds, guarded, guarded_3}
#import bevy_restir::common::math::{is_finite_3, max_component}

// A pair of directions in world space, and in the local frame where the shading normal is z.
struct Directions {
    wo: vec3<f32>,
    wi: vec3<f32>,
    local_wo: vec3<f32>,
    local_wi: vec3<f32>,
    has_valid_sides: bool,           // wo is above n and n_geo, and wi is above both or below both; lobes of the base are 0 otherwise
}

// f·|n·wi| of all lobes except deltas.
fn bsdf_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return lobes_eval(b, directions_of(b, wo, wi));
}

fn lobes_eval(b: Bsdf, p: Directions) -> vec3<f32> {
    var f = vec3<f32>(0.0);
    if p.has_valid_sides {
        f = base_eval(b, p, LOBE_DIFFUSE) + base_eval(b, p, LOBE_REFLECTION) + base_eval(b, p, LOBE_TRANSMISSION);
    }
    return (1.0 - coat_share(b, p.wo)) * f + lobe_eval(b, p, LOBE_COAT);
}

// Marginal density of `bsdf_sample` over all lobes except deltas, solid angle of wi.
fn bsdf_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return sum_of_lobes(lobe_pdfs(b, directions_of(b, wo, wi)));
}

// Joint densities of direction and lobe, one component per lobe in the order of LOBE_*.
fn lobe_pdfs(b: Bsdf, p: Directions) -> vec4<f32> {
    let choice = lobe_choice(b, p.wo, p.local_wo.z);
    var pdf = vec3<f32>(0.0);
    if p.has_valid_sides {
        pdf = vec3<f32>(
            base_pdf(b, p, LOBE_DIFFUSE, choice.specular),
            base_pdf(b, p, LOBE_REFLECTION, choice.specular),
            base_pdf(b, p, LOBE_TRANSMISSION, choice.specular),
        );
    }
    return vec4<f32>((1.0 - choice.coat) * pdf, select(0.0, choice.coat * coat_pdf(b, p.wo, p.wi), coat_is_rough(b)));
}

fn sum_of_lobes(pdf: vec4<f32>) -> f32 {
    return pdf.x + pdf.y + pdf.z + pdf.w;
}

// `bsdf_eval` and `bsdf_pdf` at once.
struct BsdfTerms {
    f: vec3<f32>,
    pdf: f32,
}

fn bsdf_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> BsdfTerms {
    let p = directions_of(b, wo, wi);
    return BsdfTerms(lobes_eval(b, p), sum_of_lobes(lobe_pdfs(b, p)));
}

// Samples a direction; u.z chooses the lobe.  A sample whose wi is on different sides of n and n_geo is invalid, and `bsdf_pdf` is 0 there.
fn bsdf_sample(b: Bsdf, wo: vec3<f32>, u: vec3<f32>) -> BsdfSample {
    var s = bsdf_draw(b, wo, u);
    if s.valid == 0u {
        return s;
    }
    if s.delta == 0u {
        let terms = bsdf_terms(b, wo, s.wi);
        s.pdf = guarded(terms.pdf, GUARD_BSDF_SAMPLE);
        if !(s.pdf > 0.0) {
            return no_bsdf_sample();
        }
        s.weight = terms.f / s.pdf;
    }
    s.weight = guarded_3(s.weight, GUARD_BSDF_SAMPLE);
    if !(max_component(s.weight) > 0.0) {
        return no_bsdf_sample();
    }
    return s;
}

// Samples direction and lobe; weight and density are left out, except the weight of a delta.
fn bsdf_draw(b: Bsdf, wo: vec3<f32>, u: vec3<f32>) -> BsdfSample {
    let frame = frame_of(b, wo);
    let o = wo * frame;
    let choice = lobe_choice(b, wo, o.z);
    if coat_is_chosen(u.z, choice.coat) {
        return coat_draw(b, wo, u.xy, choice.coat);
    }
    if !(o.z > 0.0) || !(dot(wo, b.n_geo) > 0.0) {
        return no_bsdf_sample();
    }
    let rough = b.roughness >= ALPHA_DELTA;
    let base_probability = 1.0 - choice.coat;
    let specular = choice.specular;
    let v = min((u.z - choice.coat) / base_probability, ONE_MINUS_EPSILON);

    // Choose diffuse or microfacets; then the sampled microfacet reflects or transmits.
    var s = no_bsdf_sample();
    var i: vec3<f32>;
    var delta_weight = vec3<f32>(0.0);
    if v < specular {
        var h = vec3<f32>(0.0, 0.0, 1.0);
        if rough {
            h = ggx_sample(o, alpha_of(b), u.xy);
        }
        let c = dot(o, h);
        let reflect_probability = reflection_probability(b, c);
        if v < specular * reflect_probability {
            i = reflection_sample(o, h);
            s.lobe = LOBE_REFLECTION;
            s.delta = u32(!rough);
            delta_weight = reflectance(b, c) / (specular * reflect_probability);
        } else {
            i = transmission_sample(b, o, h);
            s.lobe = LOBE_TRANSMISSION;
            s.delta = u32(transmission_is_delta(b));
            s.eta = b.eta;
            delta_weight = transmitted_share(b, c) / (specular * (1.0 - reflect_probability) * b.eta * b.eta);
            if rough {
                delta_weight *= ggx_masking_ratio(o, i, alpha_of(b));
            }
        }
    } else {
        i = diffuse_sample(b, vec3<f32>(u.xy, min((v - specular) / (1.0 - specular), ONE_MINUS_EPSILON)));
        s.lobe = LOBE_DIFFUSE;
    }

    // Reflection must stay above n and n_geo, transmission below both: the other side belongs to another lobe.  NaN is on neither side.
    s.wi = normalize(frame * i);
    _ = guard_holds(is_finite_3(s.wi), GUARD_BSDF_SAMPLE);
    let below = s.lobe == LOBE_TRANSMISSION || (s.lobe == LOBE_DIFFUSE && i.z < 0.0);
    let side = select(1.0, -1.0, below);
    s.valid = u32(side * dot(s.wi, frame[2]) > 0.0 && side * dot(s.wi, b.n_geo) > 0.0);
    s.weight = select(vec3<f32>(0.0), delta_weight * ((1.0 - coat_share(b, wo)) / base_probability), s.delta != 0u);
    return s;
}

// Whether every lobe that contributes is a delta, so that NEE cannot contribute.
fn bsdf_is_delta(b: Bsdf) -> bool {
    return b.roughness < ALPHA_DELTA && !(max_component(diffuse_albedo(b)) > 0.0) && !coat_is_rough(b);
}

// Whether scattering does not depend on the direction that light comes from.
fn bsdf_is_diffuse(b: Bsdf) -> bool {
    return !is_specular(b) && !(coat_share(b, b.n) > 0.0);
}

fn bsdf_lobe_is_delta(b: Bsdf, lobe: u32) -> bool {
    switch lobe {
        case LOBE_REFLECTION: {
            return b.roughness < ALPHA_DELTA;
        }
        case LOBE_TRANSMISSION: {
            return transmission_is_delta(b);
        }
        case LOBE_COAT: {
            return !coat_is_rough(b);
        }
        default: {
            return false;
        }
    }
}

// f·|n·wi| of one lobe; 0 for a delta.
fn bsdf_eval_lobe(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> vec3<f32> {
    return lobe_eval(b, directions_of(b, wo, wi), lobe);
}

// The component of `lobe_pdfs` for a lobe; 0 for a delta.
fn pdf_of_lobe(pdf: vec4<f32>, lobe: u32) -> f32 {
    return select(select(select(pdf.z, pdf.y, lobe == LOBE_REFLECTION), pdf.x, lobe == LOBE_DIFFUSE), pdf.w, lobe == LOBE_COAT);
}

// Value and joint density of one lobe, and the marginal density over all lobes.
struct LobeTerms {
    f: vec3<f32>,
    pdf_lobe: f32,
    pdf: f32,
}

fn bsdf_lobe_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> LobeTerms {
    let p = directions_of(b, wo, wi);
    let pdf = lobe_pdfs(b, p);
    return LobeTerms(lobe_eval(b, p, lobe), pdf_of_lobe(pdf, lobe), sum_of_lobes(pdf));
}

fn directions_of(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> Directions {
    let frame = frame_of(b, wo);
    let i = wi * frame;
    let o = wo * frame;
    let has_valid_sides = o.z > 0.0 && dot(wo, b.n_geo) > 0.0 && i.z * dot(wi, b.n_geo) > 0.0;
    return Directions(wo, wi, o, i, has_valid_sides);
}

fn lobe_eval(b: Bsdf, p: Directions, lobe: u32) -> vec3<f32> {
    if lobe == LOBE_COAT {
        return vec3<f32>(select(0.0, coat_eval(b, p.wo, p.wi), coat_is_rough(b)));
    }
    if !p.has_valid_sides {
        return vec3<f32>(0.0);
    }
    return (1.0 - coat_share(b, p.wo)) * base_eval(b, p, lobe);
}

// f·|n·wi| of one lobe of the base, without the coat.
fn base_eval(b: Bsdf, p: Directions, lobe: u32) -> vec3<f32> {
    if bsdf_lobe_is_delta(b, lobe) {
        return vec3<f32>(0.0);
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return diffuse_eval(b, p.local_wo, p.local_wi);
        }
        case LOBE_REFLECTION: {
            return reflection_eval(b, p.local_wo, p.local_wi);
        }
        default: {
            return transmission_eval(b, p.local_wo, p.local_wi);
        }
    }
}

// Joint density of direction and lobe in the base; `specular` is the probability of choosing microfacets.
fn base_pdf(b: Bsdf, p: Directions, lobe: u32, specular: f32) -> f32 {
    if bsdf_lobe_is_delta(b, lobe) {
        return 0.0;
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return (1.0 - specular) * diffuse_pdf(b, p.local_wi);
        }
        case LOBE_REFLECTION: {
            if !(p.local_wi.z > 0.0) {
                return 0.0;
            }
            let c = dot(p.local_wo, normalize(p.local_wo + p.local_wi));
            return specular * reflection_probability(b, c) * reflection_pdf(b, p.local_wo, p.local_wi);
        }
        default: {
            let c = transmission_cosine(b, p.local_wo, p.local_wi);
            return specular * (1.0 - reflection_probability(b, c)) * transmission_pdf(b, p.local_wo, p.local_wi);
        }
    }
}
