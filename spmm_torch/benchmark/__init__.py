"""Speed against error, measured on this machine: `spmm benchmark [INPUT] -o OUT`.

`OUT/benchmark.json` holds all results, `OUT/benchmark.html` shows them. Keys of the JSON follow;
values that are not finite are null, and parts that were not asked for are missing:

    version: of this schema.
    environment: cpu, cores, threads, device, system, versions {package}, commit (`+`: changed
        since; null: no checkout).
    input: path, texels, direction_pairs, channels, raw_bytes.
    protocol: repeats (at most), patience_seconds (after which nothing is repeated), overrides
        (settings changed for all fits, in a small benchmark).
    default: the fit with default settings, a FIT.
    sweep: rows [FIT + name, group, changes, mean_snr_db, on_front {seconds, bytes, both}].
    peers: rows [peer, name, group (whole, search, selection), texels (measured on), seconds (a
        TIME, from decoded values), snr_db, bytes (null: of a part), mean_basis_per_texel, note],
        skipped [peer, reason].
    rates: rows [material, curve, name, ours (true or false), bytes_per_texel, bytes (all), snr_db,
        flip (mean over slices; null without the extra `eval`), seconds], leads [material, curve,
        cost (bytes_per_texel, bytes), quality (snr_db, flip), first, end (bytes from which and up
        to which a peer is ahead; null: no end), lead (the largest; null: we have nothing so
        small)].
    weightings: rows [FIT + error (auto, cube-root, log), mssim {y, cr, cb, mean}, flip (null
        without the extra `eval`)].
    scaling: rows [varies (texels, directions), texels, direction_pairs, device, threads, seconds
        {stage}, snr_db, total_basis], exponents [varies, device, threads, power {stage}].
    limits: machine {flops_per_second, bytes_per_second, product, copy (TIMEs)}, bare_decoding (a
        TIME, or null), rows [stage, seconds, flops, bytes, limit_seconds, fraction, counted_flops,
        counted_bytes, counted_fraction].
    launches: launch_seconds (of one operation), rows [stage, launches, waits (of the host),
        bytes_to_device, bytes_to_host, seconds (to launch)], launches and waits [line, count] (the
        worst lines); of a fit on a simulated GPU, with other settings as in default.

    TIME: median, fastest, slowest (seconds), runs.
    FIT: seconds (a TIME, from the input on disk), stages {stage: median seconds}, and, as in
        `report.json`, snr_db, mean_basis_per_texel, total_basis, bytes, compression_ratio,
        peak_memory_bytes (null where the system cannot measure the peak of a single fit).
"""
