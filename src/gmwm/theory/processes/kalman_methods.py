"""Methods that models and fits share: the Kalman filter, smoother, predictor and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from numpy.typing import ArrayLike

from gmwm.recording.signals import Signal

if TYPE_CHECKING:
    from gmwm.fitting.likelihood.innovations import Residuals
    from gmwm.fitting.likelihood.tracks import Modelled, Tracks


class KalmanMethods:
    """Methods that apply a model with values to a recording; `Model`, `Fit` and `LikelihoodFit` inherit from it."""

    @property
    def _modelled(self) -> Modelled:
        """The object itself, with the type that `gmwm.likelihood` expects."""
        return cast("Modelled", self)

    def kalman_filter(
        self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None
    ) -> Tracks:
        """Estimate the latent processes at each sample from this and all earlier samples, as a real-time filter does.

        Parameters
        ----------
        data : Signal or (N,) array
            The recording. Gaps of a signal are missing samples; in an array, NaN marks a missing sample.
        rate : float, optional
            Sampling rate (Hz). A model needs it with an array; a fit knows it.
        mean : float, optional
            Mean of the recording, in its unit, if it is known; unknown by default.

        Returns
        -------
        Tracks
            Mean and standard deviation of each latent process at each sample.

        Raises
        ------
        ModelError
            If a parameter has no value, or the model predicts a sample without error.
        MissingTheoryError
            If a term has no state-space form.
        DataError, OptionError
            If the data, the rate or the mean is invalid.

        Examples
        --------
        >>> from gmwm import RW, WN
        >>> model = WN(sigma2=1.0) + RW(gamma2=1e-4)
        >>> tracks = model.kalman_filter(model.simulate(1000, 100.0, rng=1), rate=100.0)
        >>> tracks.labels
        ('WN', 'RW', 'bias')
        """
        from gmwm.fitting.likelihood.tracks import filter_tracks

        return filter_tracks(self._modelled, data, rate, mean=mean)

    def smooth(self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None) -> Tracks:
        """Estimate the latent processes at each sample from the whole recording, by the fixed-interval smoother.

        Parameters
        ----------
        data : Signal or (N,) array
            The recording. Gaps of a signal are missing samples; in an array, NaN marks a missing sample.
        rate : float, optional
            Sampling rate (Hz). A model needs it with an array; a fit knows it.
        mean : float, optional
            Mean of the recording, in its unit, if it is known; unknown by default.

        Returns
        -------
        Tracks
            Mean and standard deviation of each latent process at each sample.

        Raises
        ------
        ModelError, MissingTheoryError, DataError, OptionError
            For the same reasons as `kalman_filter`.

        References
        ----------
        Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., section 4.4.
        """
        from gmwm.fitting.likelihood.tracks import smooth_tracks

        return smooth_tracks(self._modelled, data, rate, mean=mean)

    def predict(
        self, data: Signal | ArrayLike, steps: int, rate: float | None = None, *, mean: float | None = None
    ) -> Tracks:
        """Predict the latent processes after the end of a recording, from all of its samples.

        Parameters
        ----------
        data : Signal or (N,) array
            The recording. Gaps of a signal are missing samples; in an array, NaN marks a missing sample.
        steps : int
            Number of samples to predict, from 1 to 10 million.
        rate : float, optional
            Sampling rate (Hz). A model needs it with an array; a fit knows it.
        mean : float, optional
            Mean of the recording, in its unit, if it is known; unknown by default.

        Returns
        -------
        Tracks
            Mean and standard deviation of each latent process at the `steps` samples after the recording.

        Raises
        ------
        ModelError, MissingTheoryError, DataError, OptionError
            For the same reasons as `kalman_filter`, or if `steps` is out of range.

        Examples
        --------
        >>> from gmwm import GM, Model
        >>> model = Model((GM(beta=1.0, sigma2=4.0),))
        >>> ahead = model.predict(model.simulate(1000, 100.0, rng=1), 10_000, rate=100.0, mean=0.0)
        >>> print(f"{ahead.error['GM'][0]:.2f} {ahead.error['GM'][-1]:.2f}")
        0.28 2.00
        """
        from gmwm.fitting.likelihood.tracks import predict_tracks

        return predict_tracks(self._modelled, data, steps, rate, mean=mean)

    def residuals(
        self,
        data: Signal | ArrayLike,
        rate: float | None = None,
        *,
        mean: float | None = None,
        estimated: int | None = None,
    ) -> Residuals:
        """Compute the standardised innovations, which are one-step prediction errors over their standard deviations.

        Parameters
        ----------
        data : Signal or (N,) array
            The recording. Gaps of a signal are missing samples; in an array, NaN marks a missing sample.
        rate : float, optional
            Sampling rate (Hz). A model needs it with an array; a fit knows it.
        mean : float, optional
            Mean of the recording, in its unit, if it is known; unknown by default.
        estimated : int, optional
            Number of parameters that were estimated from this recording. Each of them reduces the degrees of freedom of
            the Ljung-Box test by one. The default is 0 for a model; for a fit it follows from the information matrix.

        Returns
        -------
        Residuals
            The innovations, with tests of whiteness and of normality. They are white and Gaussian with variance 1 if
            the model is correct.

        Raises
        ------
        ModelError, MissingTheoryError, DataError, OptionError
            For the same reasons as `kalman_filter`.

        Examples
        --------
        >>> from gmwm import RW, WN, fit_ml
        >>> x = (WN(sigma2=1.0) + RW(gamma2=1e-4)).simulate(5_000, 100.0, rng=1)
        >>> fit_ml(WN() + RW(), x, rate=100.0).residuals(x).ljung_box().p_value > 0.01
        True
        """
        from gmwm.fitting.likelihood.innovations import residuals

        return residuals(self._modelled, data, rate, mean=mean, estimated=estimated)
