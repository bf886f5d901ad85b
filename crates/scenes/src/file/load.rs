//! Reads a scene file into a [`Scene`].

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use naga::ShaderStage;
use preshade_plan::plan::Plan;
use preshade_plan::state::{Blend, ColorTarget};
use toml::Spanned;

use super::import::Parts;
use super::loader::Loader;
use super::meshes;
use super::place::Folder;
use super::size::{self, MAX_SIZE};
use crate::camera::{self, Orbit, Pose};
use crate::file::entries::{
    BlendName, CameraEntry, DrawEntry, FieldKind, MaterialEntry, transform, values,
};
use crate::file::place::Access;
use crate::file::text::{SceneText, parsed};
use crate::file::variables::Variables;
use crate::file::{light as light_entry, range as range_entry};
use crate::image::{Reading, decode};
use crate::shader::roles::Roles;
use preshade_compiler::front;
use preshade_draw::scene::bind::{self, unknown_stream};
use preshade_draw::scene::image::MAX_SIDE;
use preshade_draw::scene::{
    Camera, Draw, DrawOrder, DrawRange, Light, Material, Mesh, Scene, SceneError, Stream, material,
    value_path,
};
use shader_text::{options, read_limited};

/// Loads a scene file. `docs/reference/scenes.md` documents the format and the folders that its
/// paths may reach.
///
/// # Errors
/// Anything wrong with the file, with its place: TOML syntax, an unknown key (with the nearest
/// known one), a size of 0, a missing material, mesh or file, a path outside of the scene's root, a
/// shader that does not compile, a value that the shader does not have.
pub fn load(path: &Path) -> Result<Scene, SceneError> {
    load_with(path, &Variables::new())
}

/// [`load`] with values for some of the scene's variables.
///
/// # Errors
/// As [`load`], or an unknown variable.
pub fn load_with(path: &Path, variables: &Variables) -> Result<Scene, SceneError> {
    load_within(path, variables, Access::default())
}

/// [`load_with`] under the limits of `access`.
///
/// # Errors
/// As [`load_with`], or a limit is exceeded.
pub fn load_within(
    path: &Path,
    variables: &Variables,
    access: Access,
) -> Result<Scene, SceneError> {
    let text = read_limited::text(path, &access.limits, "source-bytes")
        .map_err(|e| SceneError::unread(path, e))?;
    read(&text, path, variables, access)
}

/// Reads scene text as if it were the file `path`. The folder must exist.
///
/// # Errors
/// As [`load_within`].
pub fn read(
    text: &str,
    path: &Path,
    variables: &Variables,
    access: Access,
) -> Result<Scene, SceneError> {
    let folder = Folder::of(path, access)?;
    let name = path.display().to_string();
    let source = SceneText { name: &name, text };
    let file = parsed(source, access.limits)?;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    Loader::new(source, folder, file, variables, access)?.scene(stem.unwrap_or_default())
}

impl Loader<'_> {
    pub fn scene(&self, stem: String) -> Result<Scene, SceneError> {
        let f = &self.file;
        let at = |e: SceneError, range: Range<usize>| self.source.at(e, range);
        let Target {
            size,
            viewport,
            samples,
        } = self.target()?;
        let [width, height] = viewport.map_or(size, |[_, _, w, h]| [w, h]);
        let aspect = width as f32 / height.max(1) as f32;
        let limits = &self.access.limits;
        let mut light = light_entry::read(&f.light, limits).map_err(|e| at(e.error, e.at))?;
        let materials = f
            .materials
            .iter()
            .map(|(name, entry)| {
                self.material(name, entry.get_ref(), samples)
                    .map_err(|e| at(e, entry.span()))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let meshes = meshes::build(
            &self.source,
            &self.folder,
            &self.variables,
            &f.meshes,
            limits,
            self.held.get(),
        )?;
        let mut parts = Parts::new(materials, meshes);
        self.draws(&mut parts, &light)?;
        if let (Some((direction, color)), None, None) =
            (parts.light, &f.light.direction, &f.light.color)
        {
            (light.direction, light.color) = (direction, color);
        }
        let cameras = match f.cameras.is_empty() {
            true => self.asset_cameras(&parts, aspect),
            false => None,
        };
        let mut scene = Scene {
            name: f.name.clone().unwrap_or(stem),
            size,
            viewport,
            depth_format: f.depth.format,
            depth_direction: f.depth.direction,
            samples,
            clear_color: f.clear,
            materials: parts.materials,
            meshes: parts.meshes.into_iter().map(|m| m.mesh).collect(),
            draws: parts.draws,
            cameras: Vec::new(),
            orders: match &f.orders {
                Some(orders) if !orders.is_empty() => orders.clone(),
                _ => vec![
                    DrawOrder::FrontToBack,
                    DrawOrder::BackToFront,
                    DrawOrder::Shuffled,
                ],
            },
            light,
            files: self.folder.files(),
            is_made_up: false,
            own_size: None,
            part: None,
            initial: Default::default(),
            rows: Default::default(),
            notes: parts.notes,
        };
        scene.cameras = match cameras {
            Some(cameras) => cameras,
            None => self.cameras(scene.aspect())?,
        };
        self.check_values(&scene)?;
        Ok(scene)
    }

    fn target(&self) -> Result<Target, SceneError> {
        let f = &self.file;
        let at = |e: SceneError, range: Range<usize>| self.source.at(e, range);
        let size = match &f.size {
            None => [640, 360],
            Some(s) if s.get_ref().iter().all(|n| (1..=MAX_SIZE).contains(n)) => *s.get_ref(),
            Some(s) => {
                let [w, h] = s.get_ref();
                let e = SceneError::new(format!("a target of {w}x{h} pixels cannot be drawn to"))
                    .help(format!("width and height are 1 to {MAX_SIZE}"));
                return Err(at(e, s.span()));
            }
        };
        let viewport = match &f.viewport {
            None => None,
            Some(v) => {
                let [x, y, w, h] = *v.get_ref();
                let inside =
                    |o: u32, n: u32, of: u32| n > 0 && o.checked_add(n).is_some_and(|e| e <= of);
                if !inside(x, w, size[0]) || !inside(y, h, size[1]) {
                    let e = SceneError::new(format!(
                        "the viewport is empty or leaves the target of {}x{} pixels",
                        size[0], size[1]
                    ))
                    .help("a viewport is [x, y, width, height], in pixels");
                    return Err(at(e, v.span()));
                }
                Some([x, y, w, h])
            }
        };
        let samples = match &f.samples {
            None => 1,
            Some(s) if matches!(s.get_ref(), 1 | 4) => *s.get_ref(),
            Some(s) => {
                let e = SceneError::new(format!("{} samples a pixel", s.get_ref()))
                    .help("WebGPU promises 1 and 4");
                return Err(at(e, s.span()));
            }
        };
        let pixels = size.into_iter().map(u64::from).product::<u64>() * u64::from(samples);
        let checked = self
            .access
            .limits
            .check("pixels", pixels, "the samples of the target");
        checked.map_err(|e| match &f.size {
            Some(s) => at(e.into(), s.span()),
            None => e.into(),
        })?;
        Ok(Target {
            size,
            viewport,
            samples,
        })
    }

    /// All draws, in the order of the file.
    fn draws(&self, parts: &mut Parts, light: &Light) -> Result<(), SceneError> {
        let data = parts
            .meshes
            .iter()
            .map(|m| size::of_mesh(&m.mesh) + size::of_joints(m.joints.len()));
        self.hold(data.sum())?;
        for entry in &self.file.draws {
            let before = parts.draws.len();
            let drawn = match &entry.get_ref().gltf {
                Some(gltf) => self
                    .asset(entry.get_ref(), gltf.get_ref(), light, parts)
                    .map_err(|e| self.source.at(e, gltf.span())),
                None => self.draw(entry.get_ref(), parts),
            };
            let counted = drawn.and_then(|()| {
                // The draws of a field differ only in their transforms.
                if let Some(draw) = parts.draws.get(before) {
                    let mesh = &parts.meshes[draw.mesh].mesh;
                    self.streams(&parts.materials[draw.material], mesh, draw)?;
                }
                Ok(())
            });
            counted.map_err(|e| self.source.at(e, entry.span()))?;
        }
        if parts.draws.is_empty() {
            return Err(
                SceneError::new(format!("`{}` draws nothing", self.source.name))
                    .help("add a [[draws]] table with a mesh and a material"),
            );
        }
        self.end_assets(parts);
        Ok(())
    }

    fn cameras(&self, aspect: f32) -> Result<Vec<Camera>, SceneError> {
        let mut cameras = Vec::new();
        let mut frames = 0_u64;
        for (i, entry) in self.file.cameras.iter().enumerate() {
            let path = entry.get_ref().path.as_ref();
            frames = frames.saturating_add(path.map_or(1, |p| p.frames.into()));
            let limits = &self.access.limits;
            let checked = limits.check("frames", frames, "the frames of all cameras");
            let camera = checked
                .map_err(SceneError::from)
                .and_then(|()| self.camera(i, entry.get_ref(), aspect));
            cameras.push(camera.map_err(|e| self.source.at(e, entry.span()))?);
        }
        if cameras.is_empty() {
            return Err(
                SceneError::new(format!("`{}` has no camera", self.source.name))
                    .help("add a [[cameras]] table with an eye and a target"),
            );
        }
        Ok(cameras)
    }

    /// Checks that every value fits its variable. Each error points at the value.
    fn check_values(&self, scene: &Scene) -> Result<(), SceneError> {
        let plans: Vec<Plan> = scene.materials.iter().map(Material::plan).collect();
        let mut seen = Vec::new();
        for draw in &scene.draws {
            // Without values of its own, a draw needs no second check.
            if draw.values.is_empty() && seen.contains(&draw.material) {
                continue;
            }
            seen.push(draw.material);
            let material = &scene.materials[draw.material];
            let (Some(pass), Some((_, frame))) =
                (plans[draw.material].main(), scene.frames().next())
            else {
                continue;
            };
            bind::check(scene, material, pass, draw, frame).map_err(|e| {
                // A material from glTF has no entry.
                let Some(entry) = self.file.materials.get(&material.name) else {
                    return e;
                };
                let draws = self.file.draws.iter().map(|d| &d.get_ref().values);
                let own = draws.filter(|raw| values(raw) == draw.values);
                let values: Vec<_> = own.chain([&entry.get_ref().values]).collect();
                let given = |key: &str| values.iter().find_map(|v| v.get(key)).map(Spanned::span);
                // The element's own value, or the value of all elements.
                let raw = e.subject().and_then(|subject| {
                    given(subject).or_else(|| given(&value_path::without_indices(subject)))
                });
                self.source.at(e, raw.unwrap_or_else(|| entry.span()))
            })?;
        }
        Ok(())
    }

    fn material(
        &self,
        name: &str,
        entry: &MaterialEntry,
        samples: u32,
    ) -> Result<Material, SceneError> {
        let files: Vec<&Spanned<String>> = match (&entry.shader, &entry.vertex, &entry.fragment) {
            (Some(both), None, None) => vec![both],
            (None, Some(v), Some(f)) => vec![v, f],
            (None, Some(v), None) => vec![v],
            _ => {
                return Err(
                    SceneError::new(format!("material `{name}` names no shader"))
                        .help("give `shader = FILE`, or `vertex = FILE` and `fragment = FILE`"),
                );
            }
        };
        let mut texts = Vec::new();
        for file in &files {
            let read = self.folder.read(file.get_ref()).and_then(|(shown, bytes)| {
                let unread = |e| SceneError::unread(Path::new(file.get_ref()), e);
                front::Source::from_bytes(shown, bytes).map_err(unread)
            });
            texts.push(read.map_err(|e| self.source.at(e, file.span()))?);
        }
        // The keys determine the stages, not the file names.
        if entry.shader.is_none() {
            let stages = [ShaderStage::Vertex, ShaderStage::Fragment];
            for (source, stage) in texts.iter_mut().zip(stages) {
                source.stage = Some(stage);
            }
        }
        let defines = entry.defines.iter();
        let defines: BTreeMap<String, String> =
            defines.map(|(k, v)| (k.clone(), v.to_string())).collect();
        // The source name is relative to the root, but `#include` is relative to the file.
        let beside = files.iter().filter_map(|f| Path::new(f.get_ref()).parent());
        let include = entry.include.iter().map(PathBuf::as_path).chain(beside);
        let include = include
            .map(|f| self.folder.folder(f))
            .collect::<Result<_, _>>()
            .map_err(|e| self.source.at(e, files[0].span()))?;
        let options = options::Options {
            defines: defines.clone().into_iter().collect(),
            vertex: entry.entry.vertex.clone(),
            fragment: entry.entry.fragment.clone(),
            include,
            clip_space: entry.clip,
            root: self.folder.root_of(files[0].get_ref()),
            limits: self.access.limits,
            ..shader_text::options::Options::default()
        };
        let parsed = front::parse(&texts, &options).map_err(|e| {
            let what = SceneError::new(format!("the shader of material `{name}`: {e}"))
                .detail(e.render(shader_text::error::Color::Never));
            self.source.at(what, files[0].span())
        })?;
        let given = values(&entry.values);
        let roles = Roles::of(&parsed, &given);
        let mut material = Material {
            name: name.to_owned(),
            file: self.folder.whole(files[0].get_ref()),
            program: parsed.program,
            vertex: parsed.vertex,
            fragment: parsed.fragment,
            defines,
            state: entry.state.clone(),
            values: given,
            textures: BTreeMap::new(),
            samplers: entry
                .samplers
                .iter()
                .map(|(n, s)| (n.clone(), *s.get_ref()))
                .collect(),
            attributes: entry
                .attributes
                .iter()
                .map(|(n, s)| (n.clone(), s.get_ref().clone()))
                .collect(),
            value_roles: roles.semantics().collect(),
            attribute_roles: roles.attributes,
            part_of: None,
        };
        self.state(&mut material, entry, samples);
        for (texture, recipe) in &entry.textures {
            let image = self
                .texture(texture, recipe.get_ref())
                .map_err(|e| self.source.at(e, recipe.span()))?;
            material.textures.insert(texture.clone(), Arc::new(image));
        }
        material::check(&material).map_err(|e| {
            let key = e.subject().unwrap_or_default();
            let span = None
                .or_else(|| entry.values.get(key).map(Spanned::span))
                .or_else(|| entry.textures.get(key).map(Spanned::span))
                .or_else(|| entry.samplers.get(key).map(Spanned::span))
                .or_else(|| entry.attributes.get(key).map(Spanned::span));
            match span {
                Some(span) => self.source.at(e, span),
                None => e,
            }
        })?;
        Ok(material)
    }

    /// Applies the scene-wide settings: depth, samples, and default targets.
    fn state(&self, material: &mut Material, entry: &MaterialEntry, samples: u32) {
        let state = &mut material.state;
        state.depth_format = self.file.depth.format;
        state.depth_direction = self.file.depth.direction;
        state.multisample.count = samples;
        if state.targets.is_empty()
            && let Some(formats) = &self.file.targets
        {
            state.targets = formats
                .get_ref()
                .iter()
                .map(|f| Some(ColorTarget::opaque(f)))
                .collect();
        }
        if let Some(blend) = entry.blend {
            if state.targets.is_empty() {
                state.targets = vec![Some(ColorTarget::opaque("rgba8unorm"))];
            }
            let blend = match blend {
                BlendName::Alpha => Blend::ALPHA,
                BlendName::Add => Blend::ADD,
            };
            for target in state.targets.iter_mut().flatten() {
                target.blend = Some(blend);
            }
            // A transparent surface should not hide others. three.js writes depth for it by
            // default. A scene gets that with `state.depth_write` on an unblended material.
            state.depth_write = false;
        }
    }

    fn texture(
        &self,
        name: &str,
        recipe: &preshade_draw::scene::image::Recipe,
    ) -> Result<preshade_draw::scene::Image, SceneError> {
        match (&recipe.file, recipe.pattern) {
            (Some(file), None) => {
                let (shown, bytes) = self.folder.read(file)?;
                let hold = |bytes| self.hold(bytes);
                decode(
                    &shown,
                    &bytes,
                    Reading::of(recipe),
                    &self.access.limits,
                    &hold,
                )
            }
            (None, Some(_)) if !(1..=MAX_SIDE).contains(&recipe.size) => Err(SceneError::new(
                format!("texture `{name}` of {0}x{0} texels", recipe.size),
            )
            .help(format!(
                "a generated texture is 1 to {MAX_SIDE} texels wide"
            ))),
            (None, Some(_)) if !(1..=MAX_SIDE).contains(&recipe.scale) => Err(SceneError::new(
                format!("texture `{name}` with {} cells across", recipe.scale),
            )
            .help(format!("`scale` is 1 to {MAX_SIDE} cells"))),
            (None, Some(_)) => {
                let (limits, side) = (&self.access.limits, recipe.size.into());
                limits.check(
                    "texture-size",
                    side,
                    format!("the side of texture `{name}`"),
                )?;
                self.hold(size::of_texels([recipe.size; 2]))?;
                Ok(recipe.generate())
            }
            _ => Err(SceneError::new(format!(
                "texture `{name}` needs either a `pattern` or a `file`"
            ))),
        }
    }

    fn draw(&self, entry: &DrawEntry, parts: &mut Parts) -> Result<(), SceneError> {
        let (materials, meshes, draws) = (&parts.materials, &parts.meshes, &mut parts.draws);
        let (Some(mesh), Some(material), true) =
            (&entry.mesh, &entry.material, entry.materials.is_empty())
        else {
            return Err(
                SceneError::new("a draw needs a `mesh` and a `material`, or a `gltf`")
                    .help("`materials` is for `gltf = { file = \"..\" }`"),
            );
        };
        let mesh_name = mesh.get_ref();
        let names = meshes.iter().map(|m| m.mesh.name.as_str());
        let mesh = self.find("mesh", mesh, names.collect())?;
        let names = materials.iter().map(|m| m.name.as_str());
        let material = self.find("material", material, names.collect())?;
        let rigged = &meshes[mesh];
        let mut draw = Draw {
            name: entry
                .name
                .clone()
                .unwrap_or_else(|| format!("{mesh_name}#{}", draws.len())),
            mesh,
            material,
            transform: transform(entry.translate, entry.rotate, entry.scale.as_ref()),
            range: DrawRange::default(),
            instances: 1,
            instance_streams: BTreeMap::new(),
            joints: rigged.joints.clone(),
            morph_weights: entry
                .morph_weights
                .clone()
                .unwrap_or_else(|| rigged.morph_weights.clone()),
            values: values(&entry.values),
            captured: None,
        };
        value_path::check(&materials[material], &draw.values).map_err(|e| {
            let raw = e.subject().and_then(|key| entry.values.get(key));
            match raw.map(Spanned::span) {
                Some(span) => self.source.at(e, span),
                None => e,
            }
        })?;
        let take = |draw: &mut Draw, copies: Option<u32>| match &entry.range {
            None => Ok(()),
            Some(r) => range_entry::take(
                *r.get_ref(),
                &rigged.mesh,
                draw,
                copies,
                &self.access.limits,
            )
            .map_err(|e| self.source.at(e, r.span())),
        };
        let Some(field) = &entry.field else {
            take(&mut draw, None)?;
            self.hold_draws(draws, 1, &draw)?;
            draws.push(draw);
            return Ok(());
        };
        let copies = meshes::copies(field.get_ref(), &self.variables, &self.access.limits)
            .map_err(|e| self.source.at(e, field.span()))?;
        match field.get_ref().kind {
            FieldKind::Instances => {
                self.hold_draws(draws, 1, &draw)?;
                self.hold(copies.saturating_mul(4 * INSTANCE_NUMBERS))
            }
            FieldKind::Draws => self.hold_draws(draws, copies, &draw),
        }
        .map_err(|e| self.source.at(e, field.span()))?;
        let places = meshes::field(field.get_ref(), &self.variables, &self.access.limits)
            .map_err(|e| self.source.at(e, field.span()))?;
        match field.get_ref().kind {
            FieldKind::Instances => {
                draw.instances = places.len() as u32;
                take(&mut draw, Some(places.len() as u32))?;
                draw.instance_streams = instance_streams(&places);
                draws.push(draw);
            }
            FieldKind::Draws => {
                take(&mut draw, None)?;
                for (i, place) in places.iter().enumerate() {
                    draws.push(Draw {
                        name: format!("{}[{i}]", draw.name),
                        transform: draw.transform * place.transform,
                        ..draw.clone()
                    });
                }
            }
        }
        Ok(())
    }

    /// Refuses unknown stream names.
    fn streams(&self, material: &Material, mesh: &Mesh, draw: &Draw) -> Result<(), SceneError> {
        let Some((attribute, stream)) = unknown_stream(material, mesh, draw) else {
            return Ok(());
        };
        let known = mesh.streams.keys().chain(draw.instance_streams.keys());
        let error = SceneError::new(format!(
            "mesh `{}`, which is drawn with material `{}`, has no stream `{stream}`",
            mesh.name, material.name
        ))
        .suggest(stream, known.map(String::as_str));
        let entry = self.file.materials.get(&material.name);
        let named = entry.and_then(|e| e.get_ref().attributes.get(attribute));
        Err(match named {
            Some(named) => self.source.at(error, named.span()),
            None => error,
        })
    }

    fn camera(&self, index: usize, entry: &CameraEntry, aspect: f32) -> Result<Camera, SceneError> {
        let range = camera::Range {
            near: entry.near,
            far: entry.far,
        };
        if !(range.near > 0.0 && range.far > range.near) {
            return Err(SceneError::new(format!(
                "near {} and far {} bound no depth range",
                range.near, range.far
            ))
            .help("0 < near < far; far = inf is allowed"));
        }
        if !(entry.fov > 0.0 && entry.fov < 180.0) {
            return Err(
                SceneError::new(format!("a field of view of {} degrees", entry.fov))
                    .help("it is vertical, above 0 and below 180"),
            );
        }
        let pose = |looks: Looks, fov: Option<f32>, time: Option<f32>| {
            let (eye, target) = looks.points()?;
            Ok(Pose {
                eye,
                target,
                fov: fov.unwrap_or(entry.fov),
                time: time.unwrap_or(entry.time),
            })
        };
        let own = Looks {
            eye: entry.eye,
            target: entry.target,
            orbit: entry.orbit,
        };
        let poses = match &entry.path {
            None => vec![pose(own, None, None)?],
            Some(path)
                if own == Looks::default()
                    && path.keys.len() > 1
                    && (2..=1000).contains(&path.frames) =>
            {
                let keys = path.keys.iter().map(|k| {
                    let looks = Looks {
                        eye: k.eye,
                        target: k.target,
                        orbit: k.orbit,
                    };
                    pose(looks, k.fov, k.time)
                });
                camera::path(
                    &keys.collect::<Result<Vec<Pose>, SceneError>>()?,
                    path.frames,
                )
            }
            Some(_) => return Err(Looks::error()),
        };
        let up = Vec3::from(entry.up);
        if poses
            .iter()
            .any(|p| (p.target - p.eye).cross(up).length_squared() == 0.0)
        {
            return Err(SceneError::new(
                "a camera looks along its up direction, or nowhere",
            ));
        }
        Ok(Camera {
            name: entry
                .name
                .clone()
                .unwrap_or_else(|| format!("camera-{index}")),
            frames: poses
                .into_iter()
                .map(|p| p.frame(up, aspect, range, self.file.depth.direction))
                .collect(),
        })
    }
}

/// Floats per copy in the instance streams: transform, colour, place.
const INSTANCE_NUMBERS: u64 = 16 + 4 + 4;

/// The colour target: size, viewport, samples per pixel.
struct Target {
    size: [u32; 2],
    viewport: Option<[u32; 4]>,
    samples: u32,
}

/// The position and direction of a camera, or of a key of its path.
#[derive(Clone, Copy, Default, PartialEq)]
struct Looks {
    eye: Option<[f32; 3]>,
    target: Option<[f32; 3]>,
    orbit: Option<Orbit>,
}

impl Looks {
    /// Eye and target.
    fn points(self) -> Result<(Vec3, Vec3), SceneError> {
        match (self.eye, self.target, self.orbit) {
            (Some(eye), Some(target), None) => Ok((eye.into(), target.into())),
            (None, None, Some(orbit)) if orbit.distance > 0.0 => {
                Ok((orbit.eye(), orbit.target.into()))
            }
            (None, None, Some(orbit)) => Err(SceneError::new(format!(
                "an orbit at a distance of {}",
                orbit.distance
            ))
            .help("the distance is above 0")),
            _ => Err(Self::error()),
        }
    }

    fn error() -> SceneError {
        SceneError::new("a camera needs an eye and a target, or an orbit, or a path of them")
            .help("a path has at least 2 keys and 2 to 1000 frames")
    }
}

/// The instance streams of a field's copies.
fn instance_streams(places: &[meshes::FieldCopy]) -> BTreeMap<String, Stream> {
    let stream = |name: &str, components: u32, data: Vec<f32>| {
        (name.to_owned(), Stream::Float { components, data })
    };
    let transforms = places.iter().flat_map(|p| p.transform.to_cols_array());
    let colors = places.iter().flat_map(|p| p.color);
    let on_ground = places.iter().flat_map(|p| p.on_ground);
    BTreeMap::from([
        stream("instance_transform", 16, transforms.collect()),
        stream("instance_color", 4, colors.collect()),
        stream("instance_place", 4, on_ground.collect()),
    ])
}
