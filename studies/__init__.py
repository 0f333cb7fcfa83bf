"""What judges the product, through its public API and command alone; in no wheel."""
