"""The stories: campaign to result, result folder, figures, report, command line."""
