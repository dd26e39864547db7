"""The command `plant-emulator`: one file per sub-command. Shell."""
