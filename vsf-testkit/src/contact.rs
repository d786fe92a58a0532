use crate::property::ask;
use std::sync::Arc;
use vsf_core::{ContactModel, Contacts, LinkChains, Posture, RestPoints};

type Property<'a, C> = fn(&Suite<'a, C>);

/// Checks that a contact model keeps the promises of [`ContactModel`].
///
/// `make` builds a model before its first touch. The robot moves along `path`, on which it has to touch some of the points
/// of `rest`.
///
/// | property |
/// | --- |
/// | two of a kind behave the same, bit for bit |
/// | contacts are of points and links that there are, with normals of unit length |
/// | what `out` held before does not matter |
/// | reset forgets all contacts |
/// | postures that are not finite or were never written are refused; those without links are refused, or touch nothing |
/// | an error leaves the contact state unchanged |
///
/// # Panics
/// With the name of the property that does not hold, or if nothing is touched on the path.
///
/// ```
/// use vsf_core::{RestPoints, nalgebra::Point3};
/// use vsf_contact::{StickSlip, link_sdfs};
/// let robot = vsf_robots::cartesian_stage(0.01)?;
/// let links = link_sdfs(robot.colliders(), &Default::default())?.links;
/// let rest = RestPoints::new((0..9).map(|i| Point3::new(0.004 * f64::from(i), 0.0, 0.0)).collect())?;
/// let mut path = Vec::new();
/// for k in 0..20 {
///     let mut posture = robot.posture();
///     robot.update_posture(&[0.002 * f64::from(k), 0.0, -0.005], &mut posture)?;
///     path.push(posture);
/// }
/// let contact = StickSlip::new(links, Default::default())?;
/// vsf_testkit::check_contact(|| contact.clone(), &rest, &path);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check_contact<C: ContactModel>(make: impl Fn() -> C, rest: &RestPoints, path: &[Posture]) {
    let suite = Suite {
        make: &make,
        rest,
        path,
    };
    let touches = suite.run(&mut make()).iter().any(|c| !c.is_empty());
    assert!(
        touches,
        "contact model: nothing is touched on the path of {} postures; take one that touches",
        path.len()
    );
    let properties: [(&str, Property<'_, C>); 6] = [
        ("two of a kind behave the same", Suite::determinism),
        ("contacts fit points and links", Suite::fits),
        ("what was there before does not matter", Suite::dirty),
        ("reset forgets all contacts", Suite::reset),
        ("postures that cannot be are refused", Suite::bad_postures),
        ("an error leaves the contact state unchanged", Suite::errors),
    ];
    for (property, check) in properties {
        ask("contact model", property, || check(&suite));
    }
}

struct Suite<'a, C> {
    make: &'a dyn Fn() -> C,
    rest: &'a RestPoints,
    path: &'a [Posture],
}

impl<C: ContactModel> Suite<'_, C> {
    /// The contacts at every posture of the path.
    fn run(&self, model: &mut dyn ContactModel) -> Vec<Contacts> {
        let at = |posture: &Posture| self.at(model, posture);
        self.path.iter().map(at).collect()
    }

    fn at(&self, model: &mut dyn ContactModel, posture: &Posture) -> Contacts {
        let mut out = Contacts::new();
        match model.step(self.rest, posture, &mut out) {
            Ok(()) => out,
            Err(error) => panic!("a good posture was refused: {error}"),
        }
    }

    fn determinism(&self) {
        let expected = self.run(&mut (self.make)());
        same(&self.run(&mut (self.make)()), &expected);
    }

    fn fits(&self) {
        let all = self.run(&mut (self.make)());
        for (k, (contacts, posture)) in all.iter().zip(self.path).enumerate() {
            if let Err(error) = contacts.check_fits(self.rest, posture) {
                panic!("posture {k}: {error}");
            }
            for (p, n_W) in contacts.points().iter().zip(contacts.normals()) {
                let length = n_W.norm();
                assert!(
                    (length - 1.0).abs() < 1e-6,
                    "posture {k}: the normal of point {p} has length {length}"
                );
            }
        }
    }

    fn dirty(&self) {
        let expected = self.run(&mut (self.make)());
        let full = expected.iter().max_by_key(|c| c.len()).unwrap();
        let mut model = (self.make)();
        for (k, (posture, expected)) in self.path.iter().zip(&expected).enumerate() {
            let mut out = full.clone();
            model.step(self.rest, posture, &mut out).unwrap();
            assert!(out == *expected, "posture {k}: other contacts");
        }
    }

    fn reset(&self) {
        let mut model = (self.make)();
        let expected = self.run(&mut model);
        model.reset();
        same(&self.run(&mut model), &expected);
    }

    /// Invalid postures: with a number that is not finite, never written, and of a robot without links.
    fn bad(&self) -> Vec<(&'static str, Posture)> {
        let (good, chains) = (&self.path[0], self.path[0].chains());
        let mut not_finite = good.clone();
        let (q, poses, _) = not_finite.parts_mut();
        q.fill(f64::NAN);
        (poses.iter_mut()).for_each(|X| X.translation.vector.x = f64::NAN);
        let nothing = LinkChains::new(0, Vec::new()).expect("no joints");
        let mut no_links = Posture::new(Arc::new(nothing));
        no_links.parts_mut();
        vec![
            ("that is not finite", not_finite),
            ("never written", Posture::new(chains.clone())),
            ("without links", no_links),
        ]
    }

    fn bad_postures(&self) {
        for (what, posture) in self.bad() {
            let (mut model, mut out) = ((self.make)(), Contacts::new());
            let result = model.step(self.rest, &posture, &mut out);
            let may_be_taken = posture.link_poses().is_empty() && out.is_empty();
            assert!(
                result.is_err() || may_be_taken,
                "a posture {what} was taken"
            );
        }
    }

    fn errors(&self) {
        let expected = self.run(&mut (self.make)());
        let mut out = Contacts::new();
        let refused = |posture: &Posture| {
            let step = (self.make)().step(self.rest, posture, &mut Contacts::new());
            step.is_err()
        };
        let bad: Vec<Posture> = (self.bad().into_iter().map(|(_, posture)| posture))
            .filter(refused)
            .collect();
        let mut model = (self.make)();
        for (k, (posture, expected)) in self.path.iter().zip(&expected).enumerate() {
            let got = self.at(&mut model, posture);
            assert!(got == *expected, "posture {k}: other contacts after errors");
            for posture in &bad {
                let result = model.step(self.rest, posture, &mut out);
                assert!(
                    result.is_err(),
                    "posture {k}: what is refused at first was taken"
                );
            }
        }
    }
}

/// Asserts equality at every posture.
fn same(got: &[Contacts], expected: &[Contacts]) {
    if let Some(k) = (0..expected.len()).find(|&k| got[k] != expected[k]) {
        panic!("posture {k}: other contacts");
    }
}
