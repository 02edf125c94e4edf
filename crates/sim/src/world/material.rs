//! What surfaces are made of, as far as a camera can tell.

use serde::{Deserialize, Serialize};

/// The material of a surface.
///
/// Depth does not depend on it; colour images of the same world do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// Short grass with blades and clover.
    Grass,
    /// Grey concrete with stains and joints.
    Concrete,
    /// Painted wall with little structure.
    Plaster,
    /// Brickwork.
    Brick,
    /// Planed wood with grain.
    Wood,
    /// Tree bark with deep vertical structure.
    Bark,
    /// Bare metal.
    Metal,
    /// Clothes of people.
    Cloth,
}

impl Material {
    /// All materials, in the order of their ids.
    pub const ALL: [Self; 8] = [
        Self::Grass,
        Self::Concrete,
        Self::Plaster,
        Self::Brick,
        Self::Wood,
        Self::Bark,
        Self::Metal,
        Self::Cloth,
    ];

    /// A number that identifies the material, the index in [`Self::ALL`].
    pub const fn id(self) -> u8 {
        self as u8
    }

    /// Mean diffuse reflectance in linear red, green and blue, 0 to 1.
    pub const fn albedo(self) -> [f32; 3] {
        match self {
            Self::Grass => [0.10, 0.20, 0.06],
            Self::Concrete => [0.35, 0.35, 0.33],
            Self::Plaster => [0.70, 0.68, 0.63],
            Self::Brick => [0.35, 0.15, 0.10],
            Self::Wood => [0.40, 0.26, 0.14],
            Self::Bark => [0.18, 0.13, 0.09],
            Self::Metal => [0.50, 0.50, 0.52],
            Self::Cloth => [0.15, 0.18, 0.35],
        }
    }

    /// Size of the coarsest structure of the surface, m: the period of its texture.
    pub const fn texture_scale_m(self) -> f64 {
        match self {
            Self::Grass => 0.15,
            Self::Concrete => 0.50,
            Self::Plaster => 0.80,
            Self::Brick => 0.25,
            Self::Wood => 0.20,
            Self::Bark => 0.10,
            Self::Metal => 1.00,
            Self::Cloth => 0.12,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_indices() {
        for (i, material) in Material::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(material.id()), i);
        }
    }
}
