"""Every constant of the diagnosis, each with its derivation or the data that it was learned on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Constants:
    """Constants of the statistical model. Counts and shares; no unit."""

    # Scatter.
    scatter_iterations: int = 4
    """Steps of expectation maximisation. Chosen: amplitudes move by less than a tenth after it."""
    nuisance_prior_freedom: float = 4.0
    """Runs that a nuisance's prior standard deviation is worth."""
    variance_prior_freedom: float = 4.0
    """Runs that the prior of a variance is worth: what a signal's other stretches show."""
    local_freedom: float = 30.0
    """Degrees of freedom that a local variance shall have: bins are pooled until it has. Chosen: it is then known to a
    quarter, sqrt(2 / 30)."""
    local_prior_freedom: float = 10.0
    """What the mean variance of the signal is worth beside it. Chosen: a third."""
    blocks: int = 8
    """Smooth blocks of time per signal."""
    block_share: float = 1.0
    """Least variance of a block's mean, in that of its bins' white noise: what is seen of it is no more certain."""
    contact_runs: int = 60
    """Scattered runs that the non-linear scatter of contact is taken from."""
    contact_columns: int = 8
    """Directions of it that are kept."""

    # Calibration.
    calibration_steps: int = 3
    """Gauss-Newton steps. Chosen: a fourth takes off less than a tenth of what is left, on development landings."""

    tried_on_machines: int = 2
    """Effects that are fitted beside the nominal and the calibrated machine, to tell which of the two explains more."""

    # Search.
    refined: int = 8
    """Single effects that are fitted with the simulator."""
    refined_beside: int = 4
    """The same from each place of the constants, where derivatives by these are dear. Chosen for time: what promises
    most beside one place of them is most often what does beside another."""
    refined_pairs: int = 8
    """Pairs that are: half of them by the grids alone, half from a fitted single effect on; of these four times as
    many where runs are cheap. Chosen: of a real servo a pair that was not tried left another certain."""
    paired: int = 4
    """Fitted single effects that every other is looked for beside, and whose fit goes on where much is left. Chosen:
    half of those fitted."""
    fit_evaluations: int = 8
    """Gauss-Newton steps of a fit. Chosen: a kinked line of 19 floors is left at 7 per feature, by four steps at 24."""
    fit_tolerance: float = 1e-3
    """Relative change of what is left, or of the parameters, at which a fit ends. Chosen: a tenth of a nat, of a
    hundred that are left."""

    joint_evaluations: int = 3
    """Gauss-Newton steps of a fit together with the constants of the machine, each time. Chosen: few, since weights and
    derivatives are taken anew between."""
    reweighings: int = 3
    """Times that a fit with the constants and the discrepancy that it leaves follow from each other. Chosen: once
    spread evenly over each signal, then twice block by block."""
    sharpened: tuple[int, ...] = (2, 1)
    """Candidates that derivatives by the constants are taken anew for, each time. Chosen: the second time moves the
    payload of an arm, on a ridge with its links' masses, by half of its deviation; a third time by a twentieth."""
    sharpened_in_doubt: tuple[int, ...] = (8, 6, 6)
    """The same before it, where even the best leaves more than `doubtful`: a simulator that is wrong in more than one
    way bends what is fitted. Chosen: on the real servo a fit of seven numbers ends after some twenty steps."""
    affordable_derivatives: int = 100
    """Constants times settings up to which candidates in doubt get derivatives of their own. Chosen for time: the 72 of
    an ankle in four exercises take up to 53 s of a core for each candidate."""
    derivatives_s: float = 2000.0
    """Simulated seconds that derivatives by all constants may take, beyond which likely candidates share them. Chosen
    for time: the four exercises of an ankle take 4500, a minute of a core."""
    doubtful: float = 2.0
    """What a fit of one parameter leaves per feature, in what healthy runs leave, above which it goes on. Chosen: an
    effect that is exactly the machine's leaves 1, with a spread of 0.15 (`length_spread`)."""

    # Detection.
    false_alarm_rate: float = 0.01
    """Of the test for a gap, per diagnosis."""
    gap_shape: float = 0.1
    """Exponent of the distribution of p-values where there is a gap. Chosen: half lie below 0.001, ln 2 / ln 1000."""
    tested_effects: int = 40
    """Effects that the smallest p-value is counted for, at least: those that are not fitted were looked at as well."""
    direction_prior_freedom: float = 4.0
    """Runs that the variance 1 along a signature is worth."""
    length_prior_freedom: float = 10.0
    """Runs that the prior spread of the length is worth."""
    length_spread: float = 0.15
    """Prior standard deviation of the logarithm of the squared length per feature, from run to run."""
    signal_accuracy: float = 1.3
    """How many times its stated accuracy, a share of each signal's range, a simulator is off in the signal and setting
    where it is farthest off. Learned on development specimens of studies/blind, healthy (318, 322, 328) or with a small
    fault (311, 315, 319): 1.0 to 1.6, most often in the roll of a foot that is pressed."""
    signal_spread: float = 0.45
    """Standard deviation of the logarithm of its square, from machine to machine. Of the six it is 0.37; chosen wider,
    since all of them have the same equations."""
    least_healthy: float = 0.1
    """Least that healthy runs are taken to leave per feature."""

    # Posterior. Those said to be learned lie where the mean logarithm of the probability of the truth is largest and
    # flat, over the 57 cases with a visible cause of 78 of the reality with development seed 11: five rigs, 35 single
    # effects, 12 pairs, 10 causes outside the library.
    discrepancy_freedom: float = 16.0
    """Degrees of freedom of model discrepancy; fewer where signals and blocks of time together are. Learned."""
    discrepancy_share: float = 0.3
    """Prior scale of what the true effect leaves per feature, in what healthy runs leave. Learned."""
    discrepancy_of_gap: float = 0.1
    """The same in the gap's own square: a large effect is off by more than a small one. Learned."""
    independent_blocks: float = 32.0
    """Blocks without references that are independent at least, however many settings share the simulator's error.
    Learned on real recordings of a cylinder and of a servo, 96 and 128 blocks: with 16 friction that grows with load is
    hardly distinguished from none of the effects there."""
    discrepancy_of_block: float = 1.0
    """Least scale of model discrepancy in blocks without references, in the variance of scatter there. Chosen: as much
    as scatter, since nothing cancels it."""
    block_freedom: float = 2.0
    """Degrees of freedom of its t distribution over the blocks of a unit. Chosen: few, so that a simulator may be far
    off in some of them. With four a line closed by 70 % of a development specimen gains half as much again, but a
    real servo's limit of torque gains more too, beside which friction with load is hardly seen."""
    pair_penalty: float = 2.0
    """Nats that a second effect costs: prior odds of a pair. Learned."""
    parameter_penalty: float = 0.5
    """Nats that every further parameter of an effect costs. Chosen: a free parameter gains half a nat by chance."""
    unknown_share: float = 0.5
    """Share of the gap that an effect outside the library would leave to be as probable as one that it has. Learned."""
    unknown_penalty: float = 1.5
    """Nats that it costs to say none of them, with all of `discrepancy_freedom`; fewer in proportion. Learned
    on 70 of 97 such cases: the mean is within 0.002 of its largest from 1 to 1.5, and no wrong name more with 1.5."""
    credible: float = 0.95
    """Probability that the set holds."""
    class_distance: float = 0.05
    """Share of a signature's squared length that another effect leaves, below which the two are equivalent."""
