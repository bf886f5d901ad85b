//! Texture and image functions. Their vector of coordinates also holds the layer and the reference.

use naga::{
    BinaryOperator, Expression, ImageClass, ImageDimension, ImageQuery, Literal, SampleLevel,
    Scalar, Statement, SwizzleComponent, TypeInner, VectorSize,
};

use super::{Body, Value, refused};
use crate::textures::{Level, Sampling, TextureFunction};
use crate::tree::{Gather, Kind, Node};
use shader_text::error::Error;

/// The parts of a vector of coordinates.
struct Coordinates {
    coordinate: Value,
    layer: Option<Value>,
    reference: Option<Value>,
    /// Whether the reference is a separate argument.
    is_apart: bool,
}

impl<'s> Body<'_, 's> {
    pub(super) fn texture_call(
        &mut self,
        function: TextureFunction,
        arguments: &'s [Node],
    ) -> Result<Option<Value>, Error> {
        let Some((first, rest)) = arguments.split_first() else {
            return Err(self.missing());
        };
        let (image, sampler) = match &*first.kind {
            Kind::Combine {
                texture, sampler, ..
            } => (self.value(texture)?, Some(self.value(sampler)?)),
            _ => (self.value(first)?, None),
        };
        let mut values = Vec::with_capacity(rest.len());
        for argument in rest {
            values.push(self.value(argument)?);
        }
        let found = match (function, sampler) {
            (TextureFunction::Size, _) => self.texture_size(image, values.first().copied())?,
            (TextureFunction::Levels, _) => {
                let query = ImageQuery::NumLevels;
                let levels = self.add(Expression::ImageQuery { image, query })?;
                self.cast(levels, Scalar::I32)?
            }
            (TextureFunction::Fetch { .. } | TextureFunction::Load, _) => {
                self.fetch(image, &values)?
            }
            (TextureFunction::Store, _) => {
                let [at, value] = values[..] else {
                    return Err(self.missing());
                };
                let of = self.coordinates(image, at, None)?;
                let store = Statement::ImageStore {
                    image,
                    coordinate: of.coordinate,
                    array_index: of.layer,
                    value,
                };
                self.push(store);
                return Ok(None);
            }
            (TextureFunction::Sample(of), Some(sampler)) => {
                self.sample(of, (image, sampler), values)?
            }
            _ => {
                return Err(self.refused("a texture function does not accept these arguments"));
            }
        };
        Ok(Some(found))
    }

    /// Divides coordinates by the last one.
    fn projected(&mut self, of: Value) -> Result<Value, Error> {
        let TypeInner::Vector { size, .. } = *self.ty(of)? else {
            return Err(self.refused("a texture function does not accept these arguments"));
        };
        let mut right = self.part(of, size as u32 - 1)?;
        let smaller = match size {
            VectorSize::Bi => None,
            VectorSize::Tri => Some(VectorSize::Bi),
            VectorSize::Quad => Some(VectorSize::Tri),
        };
        let left = match smaller {
            None => self.part(of, 0)?,
            Some(size) => {
                right = self.splat(size, right)?;
                self.resized(size, of)?
            }
        };
        let op = BinaryOperator::Divide;
        self.binary_of(op, left, right)
    }

    fn sample(
        &mut self,
        sampling: Sampling,
        (image, sampler): (Value, Value),
        values: Vec<Value>,
    ) -> Result<Value, Error> {
        let at = self.span;
        let missing = || refused("an argument is missing", at);
        let mut values = values.into_iter();
        let mut at = values.next().ok_or_else(missing)?;
        if sampling.projects {
            at = self.projected(at)?;
        }
        let of = self.coordinates(image, at, values.as_slice().first().copied())?;
        if of.is_apart {
            values.next();
        }
        let mut next = || values.next().ok_or_else(missing);
        let mut level = match sampling.level {
            Level::Implicit => SampleLevel::Auto,
            Level::Exact => SampleLevel::Exact(next()?),
            Level::Gradient => SampleLevel::Gradient {
                x: next()?,
                y: next()?,
            },
        };
        // WGSL's comparisons have no other level.
        if of.reference.is_some() && sampling.level != Level::Implicit {
            level = SampleLevel::Zero;
        }
        let offset = match sampling.has_offset {
            true => Some(next()?),
            false => None,
        };
        if let (SampleLevel::Auto, Some(bias)) = (level, values.next()) {
            level = SampleLevel::Bias(bias);
        }
        let array_index = match of.layer {
            Some(layer) => Some(self.cast(layer, Scalar::I32)?),
            None => None,
        };
        let sample = Expression::ImageSample {
            image,
            sampler,
            gather: None,
            coordinate: of.coordinate,
            array_index,
            offset,
            level,
            depth_ref: of.reference,
            clamp_to_edge: false,
        };
        self.add(sample)
    }

    fn fetch(&mut self, image: Value, values: &[Value]) -> Result<Value, Error> {
        let Some(at) = values.first() else {
            return Err(self.missing());
        };
        let of = self.coordinates(image, *at, None)?;
        let is_multi = match *self.ty(image)? {
            TypeInner::Image { class, .. } => class.is_multisampled(),
            _ => false,
        };
        let which = values.get(1).copied();
        let load = Expression::ImageLoad {
            image,
            coordinate: of.coordinate,
            array_index: of.layer,
            sample: which.filter(|_| is_multi),
            level: which.filter(|_| !is_multi),
        };
        self.add(load)
    }

    fn texture_size(&mut self, image: Value, level: Option<Value>) -> Result<Value, Error> {
        let TypeInner::Image { arrayed, .. } = *self.ty(image)? else {
            return Err(self.refused("this is not a texture"));
        };
        let query = ImageQuery::Size { level };
        let mut size = self.add(Expression::ImageQuery { image, query })?;
        if arrayed {
            let mut components = Vec::new();
            let whole = match *self.ty(size)? {
                TypeInner::Vector { size: n, .. } => {
                    for index in 0..n as u32 {
                        components.push(self.part(size, index)?);
                    }
                    match n {
                        VectorSize::Bi => VectorSize::Tri,
                        _ => VectorSize::Quad,
                    }
                }
                _ => {
                    components.push(size);
                    VectorSize::Bi
                }
            };
            let query = ImageQuery::NumLayers;
            components.push(self.add(Expression::ImageQuery { image, query })?);
            let ty = self.builder.insert(TypeInner::Vector {
                size: whole,
                scalar: Scalar::U32,
            });
            size = self.compose(ty, components)?;
        }
        self.cast(size, Scalar::I32)
    }

    fn coordinates(
        &mut self,
        image: Value,
        at: Value,
        next: Option<Value>,
    ) -> Result<Coordinates, Error> {
        let TypeInner::Image {
            dim,
            arrayed,
            class,
        } = *self.ty(image)?
        else {
            return Err(self.refused("this is not a texture"));
        };
        let wanted = match dim {
            ImageDimension::D1 => None,
            ImageDimension::D2 => Some(VectorSize::Bi),
            ImageDimension::D3 | ImageDimension::Cube => Some(VectorSize::Tri),
        };
        let given = match *self.ty(at)? {
            TypeInner::Vector { size, .. } => Some(size),
            _ => None,
        };
        let coordinate = match (wanted, given) {
            (Some(size), Some(given)) if size != given => self.resized(size, at)?,
            (None, Some(_)) => self.part(at, 0)?,
            _ => at,
        };
        let mut index = wanted.map_or(1, |size| size as u32);
        let mut layer = None;
        if arrayed {
            layer = Some(self.part(at, index)?);
            index += 1;
        }
        let compares = matches!(class, ImageClass::Depth { .. });
        let is_apart = compares && index == 4;
        let reference = match (compares, is_apart) {
            (false, _) => None,
            (true, true) => next,
            (true, false) => Some(self.part(at, index)?),
        };
        Ok(Coordinates {
            coordinate,
            layer,
            reference,
            is_apart,
        })
    }

    pub(super) fn gather(&mut self, of: &'s Gather) -> Result<Value, Error> {
        let image = self.value(&of.texture)?;
        let sampler = self.value(&of.sampler)?;
        let coordinate = self.value(&of.coordinates)?;
        let depth_ref = match &of.depth {
            Some(depth) => Some(self.value(depth)?),
            None => None,
        };
        let offset = match of.offset {
            Some(parts) => {
                let ty = self.builder.insert(TypeInner::Vector {
                    size: VectorSize::Bi,
                    scalar: Scalar::I32,
                });
                let mut components = Vec::new();
                for n in parts {
                    components.push(self.literal(Literal::I32(n))?);
                }
                Some(self.compose(ty, components)?)
            }
            None => None,
        };
        let sample = Expression::ImageSample {
            image,
            sampler,
            gather: Some(SwizzleComponent::XYZW[of.component.min(3) as usize]),
            coordinate,
            array_index: None,
            offset,
            level: SampleLevel::Zero,
            depth_ref,
            clamp_to_edge: false,
        };
        self.add(sample)
    }

    /// The image and coordinates of an image atomic.
    pub(super) fn texel(
        &mut self,
        image: &'s Node,
        at: &'s Node,
    ) -> Result<[Option<Value>; 3], Error> {
        let image = self.value(image)?;
        let at = self.value(at)?;
        let of = self.coordinates(image, at, None)?;
        Ok([Some(image), Some(of.coordinate), of.layer])
    }
}
