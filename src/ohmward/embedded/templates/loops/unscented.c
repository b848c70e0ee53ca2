    /* Sigma points along SoC, the only state in which the voltage is not linear. */
    const float floor = @PIVOT_FLOOR@ * fabsf(lower[0]) + @TINY@;
    const float offset = @SCALE@ * sqrtf(lower[0] < floor ? floor : lower[0]);
    const float middle = @NAME@_curve(mean[0], &clean);
    const float plus = @NAME@_curve(mean[0] + offset, &clean), minus = @NAME@_curve(mean[0] - offset, &clean);
    const float even = plus + minus - 2.0f * middle, b = @SIDE@ * even;
    const float slope = (plus - minus) / (2.0f * offset), expected = middle + b;
    const float R = @VOLTAGE_VARIANCE@ + (@PAIR@ * (even * even) + @CENTRE@ * (b * b));
