use crate::effect::{Compensator, check, follows_contact};
use crate::{Acts, Effect, GapError, RandomWalk, Sample, Site, Touch};
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_contact::ContactConfig;

/// A model of the recording: effects with their parameters.
#[derive(Clone, Default)]
pub struct Model {
    /// The effects in it and their parameters.
    pub parts: Vec<(Arc<dyn Effect>, Vec<f64>)>,
}

impl Model {
    /// The nominal model with one effect added.
    pub fn of(effect: &Arc<dyn Effect>, theta: &[f64]) -> Self {
        Self {
            parts: vec![(effect.clone(), theta.to_vec())],
        }
    }

    /// This model with one more effect.
    #[must_use]
    pub fn with(&self, effect: &Arc<dyn Effect>, theta: &[f64]) -> Self {
        let mut model = self.clone();
        model.parts.push((effect.clone(), theta.to_vec()));
        model
    }

    /// Whether parameters of any effect are relative to the contact that they were found in, such as the distance at which
    /// points begin to be touched.
    pub fn follows_contact(&self) -> bool {
        self.parts
            .iter()
            .any(|(effect, _)| follows_contact(effect.as_ref()))
    }

    /// The model with only the effects for which [`Model::follows_contact`] holds, and the model with the others.
    pub(crate) fn by_contact(&self) -> (Self, Self) {
        self.parted(follows_contact)
    }

    /// The model with some of its effects alone, and the model with the others.
    pub(crate) fn parted(&self, some: impl Fn(&dyn Effect) -> bool) -> (Self, Self) {
        let (some, others) = (self.parts.iter().cloned()).partition(|(e, _)| some(e.as_ref()));
        (Self { parts: some }, Self { parts: others })
    }

    /// The deepest part of the model that any of the effects acts on.
    pub fn acts(&self) -> Acts {
        let acts = self.parts.iter().map(|(effect, _)| effect.acts());
        acts.max().unwrap_or(Acts::Torques)
    }

    /// The model with only the effects that act on `acts`.
    pub(crate) fn acting_on(&self, acts: Acts) -> Self {
        let parts = self.parts.iter().filter(|(e, _)| e.acts() == acts);
        Self {
            parts: parts.cloned().collect(),
        }
    }

    /// Whether `other` has the same effects with the same parameters, in the same order.
    pub(crate) fn is(&self, other: &Self) -> bool {
        self.parts.len() == other.parts.len()
            && (self.parts.iter().zip(&other.parts)).all(|((a, x), (b, y))| {
                Arc::ptr_eq(a, b)
                    && x.iter()
                        .map(|v| v.to_bits())
                        .eq(y.iter().map(|v| v.to_bits()))
            })
    }

    /// Combines its effects into one: each changes what those before it left, and object shifts add up.
    ///
    /// # Errors
    /// A wrong number of parameters, or parameters that are not finite or that an effect cannot take.
    pub fn compensator(&self, site: &Site) -> Result<Box<dyn Compensator>, GapError> {
        let make = |(effect, theta): &(Arc<dyn Effect>, Vec<f64>)| {
            check(effect.name(), theta, effect.parameters(site).len())?;
            Ok((effect.acts(), effect.compensator(site, theta)?))
        };
        let parts = self
            .parts
            .iter()
            .map(make)
            .collect::<Result<_, GapError>>()?;
        Ok(Box::new(Effects(parts)))
    }

    /// How its effects stray from what their parameters say.
    ///
    /// # Errors
    /// Walks that are not finite or of another number of joints.
    pub(crate) fn random_walks(&self, site: &Site) -> Result<Vec<RandomWalk>, GapError> {
        let walk = |(effect, theta): &(Arc<dyn Effect>, Vec<f64>)| {
            let walk = effect.random_walk(site, theta)?;
            let checked = walk.check(site.joints()).map(|()| walk);
            Some(checked.map_err(|e| GapError::Model {
                effect: effect.name().to_owned(),
                problem: e.to_string(),
            }))
        };
        self.parts.iter().filter_map(walk).collect()
    }

    /// The names of its effects, in one text.
    pub(crate) fn name(&self) -> String {
        let names: Vec<&str> = self.parts.iter().map(|(e, _)| e.name()).collect();
        names.join(" and ")
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = self.parts.iter().map(|(e, theta)| (e.name(), theta));
        f.debug_map().entries(parts).finish()
    }
}

/// Effects in order. None does more than it says it [acts](Effect::acts) on, since models share contacts on that ground.
#[derive(Clone)]
struct Effects(Vec<(Acts, Box<dyn Compensator>)>);

impl Effects {
    /// The effects that act at this depth or deeper.
    fn on(&mut self, least: Acts) -> impl Iterator<Item = &mut Box<dyn Compensator>> {
        let deep = self.0.iter_mut().filter(move |(acts, _)| *acts >= least);
        deep.map(|(_, c)| c)
    }
}

impl Compensator for Effects {
    fn begin_sequence(&mut self, sequence: &str) {
        self.on(Acts::Torques)
            .for_each(|c| c.begin_sequence(sequence));
    }

    fn begin_touch(&mut self) {
        self.on(Acts::Torques).for_each(|c| c.begin_touch());
    }

    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        self.on(Acts::Contact).for_each(|c| c.joints(sample, q));
    }

    fn motion(&mut self, sample: &Sample<'_>, qd: &mut [f64], qdd: &mut [f64]) {
        self.on(Acts::Contact)
            .for_each(|c| c.motion(sample, qd, qdd));
    }

    fn contact(&self, config: &mut ContactConfig) {
        let of_contact = self.0.iter().filter(|(acts, _)| *acts == Acts::Contact);
        of_contact.for_each(|(_, c)| c.contact(config));
    }

    fn object_shift(&mut self, sample: &Sample<'_>) -> Vector3<f64> {
        self.on(Acts::Contact).map(|c| c.object_shift(sample)).sum()
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        self.on(Acts::Springs)
            .for_each(|c| c.springs(sample, touch, springs));
    }

    fn gains(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, gains: &mut [f64]) {
        self.on(Acts::Torques)
            .for_each(|c| c.gains(sample, touch, gains));
    }

    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        self.on(Acts::Torques)
            .for_each(|c| c.torques(sample, touch, tau));
    }
}
