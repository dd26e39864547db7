"""The table writer, which saves the health every few milliseconds: a kill then often falls into a save."""

from positioner.store import health_keeper, writer

health_keeper.SAVE_AFTER_S = 0.003

if __name__ == "__main__":
    writer.main()
