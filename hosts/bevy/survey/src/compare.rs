//! What differs between the three.

use std::path::Path;

use bevy::math::Vec3;
use bevy::{Drawn, Texels, View, covered};
use bevy_preshade::State;
use serde_json::{Value, json};

/// The row of an example: drawn without a pre-pass, with Bevy's, and with the derived one. `bevy` is
/// null where Bevy's own pre-pass ends the app.
pub fn row(name: &str, [main, own, derived]: &[Drawn; 3]) -> Value {
    let views = derived.views.iter().enumerate();
    let views: Vec<_> = views
        .map(|(i, view)| of_view(main.views.get(i), own.views.get(i), view))
        .collect();
    let derivations: Vec<_> = derived.rows.iter().map(derivation).collect();
    json!({
        "example": name,
        "adapter": derived.adapter,
        "settled": !derived.is_pending,
        "views": views,
        "derivations": derivations,
    })
}

fn derivation(row: &bevy_preshade::Row) -> Value {
    let state = match &row.state {
        State::Pending => "pending".to_owned(),
        State::Derived { .. } => "derived".to_owned(),
        State::Refused(refused) => format!("{}: {}", refused.code, refused.reason),
    };
    json!({
        "material": row.material,
        "normal": row.normal,
        "motion": row.motion,
        "state": state,
        "ms": (row.time.as_secs_f64() * 1e5).round() / 100.0,
    })
}

/// Texels that differ from those of the main pass alone, and differences from Bevy's own pre-pass.
fn of_view(main: Option<&View>, own: Option<&View>, derived: &View) -> Value {
    let from_main = |view: Option<&View>, of: fn(&View) -> Option<&Texels>| {
        let pair = main.and_then(of).zip(view.and_then(of));
        pair.map(|(main, view)| differ(main, view))
    };
    let ahead = |view: Option<&View>| {
        let pair = main.zip(view.and_then(|view| view.passes.ahead.as_ref()));
        pair.map(|(main, ahead)| differ(&main.passes.depth, ahead))
    };
    let both = |of: fn(&View) -> Option<&Texels>, by: fn(&Texels, &Texels) -> f32| {
        let pair = own.and_then(of).zip(of(derived));
        pair.map(|(own, derived)| by(own, derived))
    };
    let shadows =
        own.map(|own| [0, 1].map(|i| differ(&own.passes.shadows[i], &derived.passes.shadows[i])));
    let derived = Some(derived);
    let after = |view| from_main(view, |v| Some(&v.passes.depth));
    let picture = |view| from_main(view, |v| Some(&v.picture));
    json!({
        "pixels": main.map(|main| covered(&main.passes.depth)),
        "ahead": { "bevy": ahead(own), "derived": ahead(derived) },
        "after": { "bevy": after(own), "derived": after(derived) },
        "picture": { "bevy": picture(own), "derived": picture(derived) },
        "shadows": {
            "texels": derived.map(|derived| derived.passes.shadows.each_ref().map(covered)),
            "derived": shadows,
        },
        "motion_pixels": both(|v| v.passes.motion.as_ref(), moved),
        "normal_degrees": both(|v| v.passes.normal.as_ref(), turned),
    })
}

fn differ(a: &Texels, b: &Texels) -> Value {
    if a.size != b.size {
        return json!({ "sizes": [a.size, b.size] });
    }
    json!(
        a.values
            .iter()
            .zip(&b.values)
            .filter(|(a, b)| a != b)
            .count()
    )
}

/// The greatest difference of motion, in pixels.
fn moved(a: &Texels, b: &Texels) -> f32 {
    let pairs = a.values.iter().zip(&b.values);
    let size = [a.size[0] as f32, a.size[1] as f32];
    let of = |(a, b): (&[f32; 4], &[f32; 4])| {
        ((a[0] - b[0]) * size[0])
            .abs()
            .max(((a[1] - b[1]) * size[1]).abs())
    };
    pairs.map(of).fold(0.0, f32::max)
}

/// The greatest angle between normals.
fn turned(a: &Texels, b: &Texels) -> f32 {
    let unit = |v: &[f32; 4]| (Vec3::new(v[0], v[1], v[2]) * 2.0 - 1.0).normalize_or_zero();
    let pairs = a.values.iter().zip(&b.values).filter(|(a, b)| a != b);
    let of = |(a, b): (&[f32; 4], &[f32; 4])| unit(a).angle_between(unit(b)).to_degrees();
    pairs.map(of).fold(0.0, f32::max)
}

/// The pictures of the first view: without a pre-pass, with Bevy's, and with the derived one.
pub fn save(name: &str, drawn: &[Drawn; 3], folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|e| e.to_string())?;
    for (mode, drawn) in ["main", "bevy", "derived"].iter().zip(drawn) {
        for (i, view) in drawn.views.iter().enumerate() {
            let Texels { size, values } = &view.picture;
            let texel =
                |v: &[f32; 4]| [0, 1, 2].map(|c| (v[c].clamp(0.0, 1.0).sqrt() * 255.0) as u8);
            let bytes: Vec<u8> = values.iter().flat_map(texel).collect();
            let path = folder.join(format!("{name}.{i}.{mode}.png"));
            let image = image::RgbImage::from_raw(size[0], size[1], bytes);
            let image = image.ok_or("a picture has another size")?;
            image.save(path).map_err(|e| e.to_string())?;
        }
    }
    Ok(())
}
