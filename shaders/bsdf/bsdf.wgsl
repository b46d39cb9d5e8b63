// The material: the sum of its lobes, (eval, sample, pdf) over all of them and lobe by lobe.  After glTF 2.0 (Appendix B and the KHR
// extensions): with one α for all microfacets of the body it is LOBE_DIFFUSE + LOBE_REFLECTION + LOBE_TRANSMISSION, all under LOBE_COAT.
// Delta lobes are sampled, never evaluated.
#define_import_path bevy_restir::bsdf::bsdf

#import bevy_restir::bsdf::coat::{coat_draw, coat_eval, coat_is_chosen, coat_is_rough, coat_pdf, coat_share}
#import bevy_restir::bsdf::diffuse::{diffuse_albedo, diffuse_eval, diffuse_pdf, diffuse_sample}
#import bevy_restir::bsdf::ggx::{ggx_masking_ratio, ggx_sample}
#import bevy_restir::bsdf::lobe_choice::{lobe_choice, reflection_probability}
#import bevy_restir::bsdf::reflection::{reflectance, reflection_eval, reflection_pdf, reflection_sample}
#import bevy_restir::bsdf::roughness::{alpha_of, frame_of}
#import bevy_restir::bsdf::transmission::{transmission_cosine, transmission_eval, transmission_is_delta, transmission_pdf, transmission_sample, transmittance}
#import bevy_restir::bsdf::types::{Bsdf, BsdfSample, LOBE_COAT, LOBE_DIFFUSE, LOBE_REFLECTION, LOBE_TRANSMISSION, no_bsdf_sample}
#import bevy_restir::common::constants::ALPHA_DELTA
#import bevy_restir::common::math::{is_finite, is_finite_3, max_component}

// Largest f32 below 1: what is left of a random number stays one.
const BELOW_ONE: f32 = 0.99999994;

// A pair of directions: in the world, and in the frame where the shading normal is z.
struct Pair {
    wo: vec3<f32>,
    wi: vec3<f32>,
    o: vec3<f32>,
    i: vec3<f32>,
    carries: bool,             // both directions are on one side of n and n_geo each; a coat has a normal of its own
}

// f·|n.wi| of all lobes but deltas
fn bsdf_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return lobes_eval(b, pair_of(b, wo, wi));
}

fn lobes_eval(b: Bsdf, p: Pair) -> vec3<f32> {
    var f = vec3<f32>(0.0);
    if p.carries {
        f = body_eval(b, p, LOBE_DIFFUSE) + body_eval(b, p, LOBE_REFLECTION) + body_eval(b, p, LOBE_TRANSMISSION);
    }
    return (1.0 - coat_share(b, p.wo)) * f + lobe_eval(b, p, LOBE_COAT);
}

// Density of `bsdf_sample`, solid angle of wi, of all lobes but deltas
fn bsdf_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return sum_of(lobe_pdfs(b, pair_of(b, wo, wi)));
}

// Lobe by lobe, in the order of LOBE_*.
fn lobe_pdfs(b: Bsdf, p: Pair) -> vec4<f32> {
    let choice = lobe_choice(b, p.wo, p.o.z);
    var pdf = vec3<f32>(0.0);
    if p.carries {
        pdf = vec3<f32>(
            body_pdf(b, p, LOBE_DIFFUSE, choice.specular),
            body_pdf(b, p, LOBE_REFLECTION, choice.specular),
            body_pdf(b, p, LOBE_TRANSMISSION, choice.specular),
        );
    }
    return vec4<f32>((1.0 - choice.coat) * pdf, select(0.0, choice.coat * coat_pdf(b, p.wo, p.wi), coat_is_rough(b)));
}

fn sum_of(pdf: vec4<f32>) -> f32 {
    return pdf.x + pdf.y + pdf.z + pdf.w;
}

// Both at once.
struct BsdfTerms {
    f: vec3<f32>,
    pdf: f32,
}

fn bsdf_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> BsdfTerms {
    let p = pair_of(b, wo, wi);
    return BsdfTerms(lobes_eval(b, p), sum_of(lobe_pdfs(b, p)));
}

// u.z chooses the lobe.  Every sample whose wi is on different sides of n and n_geo is lost, and `bsdf_pdf` is 0 there.
fn bsdf_sample(b: Bsdf, wo: vec3<f32>, u: vec3<f32>) -> BsdfSample {
    var s = bsdf_draw(b, wo, u);
    if s.valid == 0u {
        return s;
    }
    if s.delta == 0u {
        let terms = bsdf_terms(b, wo, s.wi);
        s.pdf = terms.pdf;
        s.weight = terms.f / max(s.pdf, 1.0e-37);
        s.valid &= u32(s.pdf > 0.0 && is_finite(s.pdf));
    }
    if s.valid == 0u || !is_finite_3(s.weight) || !(max_component(s.weight) > 0.0) {
        return no_bsdf_sample();
    }
    return s;
}

// The same without weight and density, but for a delta's weight.
fn bsdf_draw(b: Bsdf, wo: vec3<f32>, u: vec3<f32>) -> BsdfSample {
    let frame = frame_of(b);
    let o = wo * frame;
    let choice = lobe_choice(b, wo, o.z);
    if coat_is_chosen(u.z, choice.coat) {
        return coat_draw(b, wo, u.xy, choice.coat);
    }
    if !(o.z > 0.0) || !(dot(wo, b.n_geo) > 0.0) {
        return no_bsdf_sample();
    }
    let rough = b.roughness >= ALPHA_DELTA;
    let of_body = 1.0 - choice.coat;
    let specular = choice.specular;
    let v = min((u.z - choice.coat) / of_body, BELOW_ONE);

    // Choose diffuse or microfacets, then what the sampled microfacet does.
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
            delta_weight = transmittance(b, c) / (specular * (1.0 - reflect_probability) * b.eta * b.eta);
            if rough {
                delta_weight *= ggx_masking_ratio(o, i, alpha_of(b));
            }
        }
    } else {
        i = diffuse_sample(b, o, vec3<f32>(u.xy, min((v - specular) / (1.0 - specular), BELOW_ONE)));
        s.lobe = LOBE_DIFFUSE;
    }

    // Reflections stay above n and n_geo, what goes through below both; the other side is another lobe's.
    s.wi = normalize(frame * i);
    let below = s.lobe == LOBE_TRANSMISSION || (s.lobe == LOBE_DIFFUSE && i.z < 0.0);
    let side = select(1.0, -1.0, below);
    s.valid = u32(side * dot(s.wi, b.n) > 0.0 && side * dot(s.wi, b.n_geo) > 0.0);
    s.weight = select(vec3<f32>(0.0), delta_weight * ((1.0 - coat_share(b, wo)) / of_body), s.delta != 0u);
    return s;
}

// Whether every lobe that contributes is a delta: then no light can be aimed at.
fn bsdf_is_delta(b: Bsdf) -> bool {
    return b.roughness < ALPHA_DELTA && !(max_component(diffuse_albedo(b)) > 0.0) && !coat_is_rough(b);
}

// It scatters alike whatever the direction that light comes from, on either side.
fn bsdf_is_diffuse(b: Bsdf) -> bool {
    let f0 = max(b.dielectric_reflectance, b.metallic * b.base_color);
    return !(max(max_component(f0), b.transmission) > 0.0) && !(coat_share(b, b.n) > 0.0);
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

// f·|n.wi| of one lobe; 0 for a delta
fn bsdf_eval_lobe(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> vec3<f32> {
    return lobe_eval(b, pair_of(b, wo, wi), lobe);
}

// Joint density of direction and lobe; 0 for a delta
fn bsdf_pdf_lobe(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> f32 {
    return of_lobe(lobe_pdfs(b, pair_of(b, wo, wi)), lobe);
}

fn of_lobe(pdf: vec4<f32>, lobe: u32) -> f32 {
    return select(select(select(pdf.z, pdf.y, lobe == LOBE_REFLECTION), pdf.x, lobe == LOBE_DIFFUSE), pdf.w, lobe == LOBE_COAT);
}

// Both of one lobe, and the density of all.
struct LobeTerms {
    f: vec3<f32>,
    pdf_lobe: f32,
    pdf: f32,
}

fn bsdf_lobe_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> LobeTerms {
    let p = pair_of(b, wo, wi);
    let pdf = lobe_pdfs(b, p);
    return LobeTerms(lobe_eval(b, p, lobe), of_lobe(pdf, lobe), sum_of(pdf));
}

fn pair_of(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> Pair {
    let frame = frame_of(b);
    let i = wi * frame;
    let o = wo * frame;
    let carries = o.z > 0.0 && dot(wo, b.n_geo) > 0.0 && i.z * dot(wi, b.n_geo) > 0.0;
    return Pair(wo, wi, o, i, carries);
}

fn lobe_eval(b: Bsdf, p: Pair, lobe: u32) -> vec3<f32> {
    if lobe == LOBE_COAT {
        return vec3<f32>(select(0.0, coat_eval(b, p.wo, p.wi), coat_is_rough(b)));
    }
    if !p.carries {
        return vec3<f32>(0.0);
    }
    return (1.0 - coat_share(b, p.wo)) * body_eval(b, p, lobe);
}

// Of what is below the coat, as if there were none.
fn body_eval(b: Bsdf, p: Pair, lobe: u32) -> vec3<f32> {
    if bsdf_lobe_is_delta(b, lobe) {
        return vec3<f32>(0.0);
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return diffuse_eval(b, p.o, p.i);
        }
        case LOBE_REFLECTION: {
            return reflection_eval(b, p.o, p.i);
        }
        default: {
            return transmission_eval(b, p.o, p.i);
        }
    }
}

fn body_pdf(b: Bsdf, p: Pair, lobe: u32, specular: f32) -> f32 {
    if bsdf_lobe_is_delta(b, lobe) {
        return 0.0;
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return (1.0 - specular) * diffuse_pdf(b, p.o, p.i);
        }
        case LOBE_REFLECTION: {
            if !(p.i.z > 0.0) {
                return 0.0;
            }
            let c = dot(p.o, normalize(p.o + p.i));
            return specular * reflection_probability(b, c) * reflection_pdf(b, p.o, p.i);
        }
        default: {
            let c = transmission_cosine(b, p.o, p.i);
            return specular * (1.0 - reflection_probability(b, c)) * transmission_pdf(b, p.o, p.i);
        }
    }
}
