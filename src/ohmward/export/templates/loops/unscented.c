    /* Sigma points along SoC, the only state that bends the voltage. */
    const float floor = @PIVOT_FLOOR@ * fabsf(lower[0]) + @TINY@;
    const float offset = @SCALE@ * sqrtf(lower[0] < floor ? floor : lower[0]);
    const float middle = @NAME@_curve(mean[0], &reading);
    const float plus = @NAME@_curve(mean[0] + offset, &reading), minus = @NAME@_curve(mean[0] - offset, &reading);
    const float curved = plus + minus - 2.0f * middle, bend = @SIDE@ * curved;
    const float beside = @ROOT_PAIR@ * (curved - 2.0f * bend), centre = @CENTRE@ * bend;
    const float slope = (plus - minus) / (2.0f * offset), expected = middle + bend;
    const float R = @VOLTAGE_VARIANCE@ + (beside * beside + centre * centre);
