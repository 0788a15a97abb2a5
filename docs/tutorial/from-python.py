"""The tutorial "From Python": a test in an emulated chamber, fitted and compensated."""

from pathlib import Path

import accelbench as ab


def main(folder: Path) -> dict[str, float]:
    """Run the tutorial in a folder and return its figures."""
    # a short sequence on emulated instruments, as `accelbench run` does it
    sequence = ab.load_sequence(Path(ab.__file__).parent / "examples/sequences/short.toml")
    outcome = ab.run_emulated(ab.make_job(sequence, folder / "store.db"))
    runs = ab.stored_runs(ab.open_existing_store(folder / "store.db"), outcome.test_id)

    # the error model of each accelerometer, and its coefficients as a table
    model = ab.fit(runs)
    print(model)
    table = model.to_dataframe()
    print(table[["serial", "name", "value", "sigma", "unit"]].to_string(index=False))

    # compensate with it; `found` holds the values themselves
    done = ab.compensate(runs, model.found[1])
    print(done)
    print(done.to_dataframe().head())

    # the pictures of the report; a notebook shows them by themselves
    pictures = model.plot()
    for picture in pictures:
        (folder / picture.name).write_bytes(picture.png)
    return {"coefficients": len(table), "pictures": len(pictures)}


if __name__ == "__main__":
    main(Path())
