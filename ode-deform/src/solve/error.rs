//! Why an integration ended early.

/// Why an integration ended early, each with the remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The times of a problem make no interval, or its step sizes no steps.
    #[error("{what} is {found}: {expected}")]
    Problem {
        /// Which number of the problem.
        what: &'static str,
        /// Its value.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// The numbers of a method do not fit together.
    #[error("the method {method} is none: {what}")]
    Tableau {
        /// The method.
        method: &'static str,
        /// What does not fit.
        what: &'static str,
    },
    /// What should end the integration is infinite or not a number.
    #[error("the value of the event at t = {t} is infinite or not a number")]
    Event {
        /// When.
        t: f64,
    },
    /// The step size should follow the error, of which this method has no estimate.
    #[error(
        "{method} estimates no error: choose adaptive-heun, heun, midpoint, bosh3, dopri5 or tsit5, or fixed steps"
    )]
    NoErrorEstimate {
        /// The method.
        method: &'static str,
    },
    /// Too many steps.
    #[error(
        "{limit} steps led only to t = {t}: raise the limit, loosen the tolerance, or look whether the field is \
         discontinuous or stiff"
    )]
    StepLimit {
        /// Where it stopped.
        t: f64,
        /// The limit.
        limit: usize,
    },
    /// The tolerance asks for smaller steps than allowed.
    #[error(
        "at t = {t} the tolerance asks for a step of {step:e}, under the least of {least:e}: loosen the tolerance, or \
         look whether the field is stiff or not smooth there"
    )]
    StepUnderflow {
        /// Where it stopped.
        t: f64,
        /// The step asked for.
        step: f64,
        /// The least one allowed.
        least: f64,
    },
    /// The state or a derivative is infinite or not a number.
    #[error(
        "the {} at t = {t} is infinite or not a number: take smaller steps, or bound the field (its last layer, its \
         learning rate)",
        stage.map_or_else(|| "state".to_owned(), |stage| format!("derivative of stage {stage}"))
    )]
    NonFinite {
        /// Where the step began.
        t: f64,
        /// The first stage whose derivative is not finite, counted from 1; none if only the state is not.
        stage: Option<usize>,
    },
}
