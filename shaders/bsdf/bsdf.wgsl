// The material: the sum of its lobes, (eval, sample, pdf) over all of them and lobe by lobe.  Design 2's body formula: with one α
// for all its microfacets it is LOBE_DIFFUSE + LOBE_REFLECTION + LOBE_TRANSMISSION.  Delta lobes are sampled, never evaluated.
#define_import_path bevy_restir::bsdf::bsdf

#import bevy_restir::bsdf::diffuse::{diffuse_albedo, diffuse_eval, diffuse_pdf, diffuse_sample}
#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::ggx::{ggx_masking_ratio, ggx_sample}
#import bevy_restir::bsdf::reflection::{reflectance, reflection_eval, reflection_pdf, reflection_sample}
#import bevy_restir::bsdf::transmission::{transmission_cosine, transmission_eval, transmission_is_delta, transmission_pdf, transmission_sample, transmittance}
#import bevy_restir::bsdf::types::{Bsdf, BsdfSample, LocalPair, LOBE_DIFFUSE, LOBE_REFLECTION, LOBE_TRANSMISSION, no_bsdf_sample}
#import bevy_restir::common::constants::ALPHA_DELTA
#import bevy_restir::common::math::{is_finite, is_finite_3, luminance, max_component, orthonormal_basis}

// Least probability of choosing either of two kinds of lobe that both contribute.
const LOBE_PROBABILITY_MIN: f32 = 0.05;

// f·|n.wi| of all lobes but deltas
fn bsdf_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return vec3<f32>(0.0);
    }
    return lobe_eval(b, p.wo, p.wi, LOBE_DIFFUSE)
        + lobe_eval(b, p.wo, p.wi, LOBE_REFLECTION)
        + lobe_eval(b, p.wo, p.wi, LOBE_TRANSMISSION);
}

// Density of `bsdf_sample`, solid angle of wi, of all lobes but deltas
fn bsdf_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return 0.0;
    }
    let pdf = lobe_pdfs(b, p);
    return pdf.x + pdf.y + pdf.z;
}

// Lobe by lobe.
fn lobe_pdfs(b: Bsdf, p: LocalPair) -> vec3<f32> {
    let specular = specular_probability(b, p.wo.z);
    return vec3<f32>(
        lobe_pdf(b, p.wo, p.wi, LOBE_DIFFUSE, specular),
        lobe_pdf(b, p.wo, p.wi, LOBE_REFLECTION, specular),
        lobe_pdf(b, p.wo, p.wi, LOBE_TRANSMISSION, specular),
    );
}

// Both at once.
struct BsdfTerms {
    f: vec3<f32>,
    pdf: f32,
}

fn bsdf_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> BsdfTerms {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return BsdfTerms(vec3<f32>(0.0), 0.0);
    }
    let f = lobe_eval(b, p.wo, p.wi, LOBE_DIFFUSE)
        + lobe_eval(b, p.wo, p.wi, LOBE_REFLECTION)
        + lobe_eval(b, p.wo, p.wi, LOBE_TRANSMISSION);
    let pdf = lobe_pdfs(b, p);
    return BsdfTerms(f, pdf.x + pdf.y + pdf.z);
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
    let frame = orthonormal_basis(b.n);
    let o = wo * frame;
    if !(o.z > 0.0) || !(dot(wo, b.n_geo) > 0.0) {
        return no_bsdf_sample();
    }
    let rough = b.roughness >= ALPHA_DELTA;
    let specular = specular_probability(b, o.z);

    // Choose diffuse or microfacets, then what the sampled microfacet does.
    var s = no_bsdf_sample();
    var i: vec3<f32>;
    var delta_weight = vec3<f32>(0.0);
    if u.z < specular {
        var h = vec3<f32>(0.0, 0.0, 1.0);
        if rough {
            h = ggx_sample(o, b.roughness, u.xy);
        }
        let c = dot(o, h);
        let reflect_probability = reflection_probability(b, c);
        if u.z < specular * reflect_probability {
            i = reflection_sample(b, o, h);
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
                delta_weight *= ggx_masking_ratio(o, i, b.roughness);
            }
        }
    } else {
        i = diffuse_sample(b, o, u.xy);
        s.lobe = LOBE_DIFFUSE;
    }

    // Reflections stay above n and n_geo, refractions below both; the other side is another lobe's.
    s.wi = normalize(frame * i);
    let side = select(1.0, -1.0, s.lobe == LOBE_TRANSMISSION);
    s.valid = u32(side * dot(s.wi, b.n) > 0.0 && side * dot(s.wi, b.n_geo) > 0.0);
    s.weight = select(vec3<f32>(0.0), delta_weight, s.delta != 0u);
    return s;
}

// Whether every lobe that contributes is a delta: then no light can be aimed at.
fn bsdf_is_delta(b: Bsdf) -> bool {
    return b.roughness < ALPHA_DELTA && !(max_component(diffuse_albedo(b)) > 0.0);
}

// It scatters alike whatever the direction that light comes from.
fn bsdf_is_diffuse(b: Bsdf) -> bool {
    let f0 = max(b.dielectric_reflectance, b.metallic * b.base_color);
    return !(max(max_component(f0), b.transmission) > 0.0);
}

fn bsdf_lobe_is_delta(b: Bsdf, lobe: u32) -> bool {
    switch lobe {
        case LOBE_REFLECTION: {
            return b.roughness < ALPHA_DELTA;
        }
        case LOBE_TRANSMISSION: {
            return transmission_is_delta(b);
        }
        default: {
            return false;
        }
    }
}

// Probability that `bsdf_sample` takes a lobe.  Reflection and transmission are chosen by the Fresnel factor at the sampled
// microfacet, so theirs is given the cosine c = wo.h (|n.wo| for a delta); diffuse ignores it.
fn bsdf_lobe_probability(b: Bsdf, wo: vec3<f32>, lobe: u32, c: f32) -> f32 {
    return lobe_probability(b, lobe, specular_probability(b, dot(wo, b.n)), c);
}

// f·|n.wi| of one lobe; 0 for a delta
fn bsdf_eval_lobe(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> vec3<f32> {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return vec3<f32>(0.0);
    }
    return lobe_eval(b, p.wo, p.wi, lobe);
}

// Joint density of direction and lobe; 0 for a delta
fn bsdf_pdf_lobe(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> f32 {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return 0.0;
    }
    return lobe_pdf(b, p.wo, p.wi, lobe, specular_probability(b, p.wo.z));
}

// Both of one lobe, and the density of all.
struct LobeTerms {
    f: vec3<f32>,
    pdf_lobe: f32,
    pdf: f32,
}

fn bsdf_lobe_terms(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> LobeTerms {
    let p = local_pair(b, wo, wi);
    if !p.carries {
        return LobeTerms(vec3<f32>(0.0), 0.0, 0.0);
    }
    let pdf = lobe_pdfs(b, p);
    let pdf_lobe = select(select(pdf.z, pdf.y, lobe == LOBE_REFLECTION), pdf.x, lobe == LOBE_DIFFUSE);
    return LobeTerms(lobe_eval(b, p.wo, p.wi, lobe), pdf_lobe, pdf.x + pdf.y + pdf.z);
}

fn local_pair(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> LocalPair {
    let frame = orthonormal_basis(b.n);
    let i = wi * frame;
    let o = wo * frame;
    let carries = o.z > 0.0 && dot(wo, b.n_geo) > 0.0 && i.z * dot(wi, b.n_geo) > 0.0;
    return LocalPair(o, i, carries);
}

fn lobe_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32) -> vec3<f32> {
    if bsdf_lobe_is_delta(b, lobe) {
        return vec3<f32>(0.0);
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return diffuse_eval(b, wo, wi);
        }
        case LOBE_REFLECTION: {
            return reflection_eval(b, wo, wi);
        }
        default: {
            return transmission_eval(b, wo, wi);
        }
    }
}

fn lobe_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, lobe: u32, specular: f32) -> f32 {
    if bsdf_lobe_is_delta(b, lobe) {
        return 0.0;
    }
    switch lobe {
        case LOBE_DIFFUSE: {
            return (1.0 - specular) * diffuse_pdf(b, wo, wi);
        }
        case LOBE_REFLECTION: {
            if !(wi.z > 0.0) {
                return 0.0;
            }
            let c = dot(wo, normalize(wo + wi));
            return lobe_probability(b, lobe, specular, c) * reflection_pdf(b, wo, wi);
        }
        default: {
            let c = transmission_cosine(b, wo, wi);
            return lobe_probability(b, lobe, specular, c) * transmission_pdf(b, wo, wi);
        }
    }
}

fn lobe_probability(b: Bsdf, lobe: u32, specular: f32, c: f32) -> f32 {
    switch lobe {
        case LOBE_DIFFUSE: {
            return 1.0 - specular;
        }
        case LOBE_REFLECTION: {
            return specular * reflection_probability(b, c);
        }
        default: {
            return specular * (1.0 - reflection_probability(b, c));
        }
    }
}

// Of microfacets against diffuse, by their albedos at the mirror direction; kept from 0 and 1 where both contribute.
fn specular_probability(b: Bsdf, cos_o: f32) -> f32 {
    let albedo = diffuse_albedo(b);
    if !(max_component(albedo) > 0.0) {
        return 1.0;
    }
    let f0 = max(b.dielectric_reflectance, b.metallic * b.base_color);
    if !(max(max_component(f0), b.transmission) > 0.0) {
        return 0.0;
    }
    let diffuse = luminance(albedo * (1.0 - schlick(b.dielectric_reflectance, cos_o)));
    let specular = luminance(reflectance(b, cos_o) + transmittance(b, cos_o));
    let p = specular / max(specular + diffuse, 1.0e-37);
    return clamp(p, LOBE_PROBABILITY_MIN, 1.0 - LOBE_PROBABILITY_MIN);
}

// Of reflection against transmission at a microfacet, c = wo.h: by what it does, so that neither is chosen in vain.
fn reflection_probability(b: Bsdf, c: f32) -> f32 {
    let r = luminance(reflectance(b, c));
    let t = luminance(transmittance(b, c));
    if !(t > 0.0) {
        return 1.0;
    }
    return r / (r + t);
}
