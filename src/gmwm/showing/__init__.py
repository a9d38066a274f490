"""Results for people and programs: plots, reports and files of navigation filters."""
