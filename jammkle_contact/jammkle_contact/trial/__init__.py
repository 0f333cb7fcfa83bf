"""The trial of contact: randomised steps, slips and landings, and how well they are felt."""
