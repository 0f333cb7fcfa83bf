"""What an ideal observer sees of each effect in each exercise."""
