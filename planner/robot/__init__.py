"""From requests to a robot: schedules, resampling and playback."""
