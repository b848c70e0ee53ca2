    /* The curve and its slope. */
    float expected, slope;
    @NAME@_curve(mean[0], &clean, &expected, &slope);
    const float R = @VOLTAGE_VARIANCE@;
