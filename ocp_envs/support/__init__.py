"""What every wing uses: arrays on CasADi functions, whole files, processes, provenance."""
