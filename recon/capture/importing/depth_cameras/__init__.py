"""What depth cameras record: pictures and depth maps, in folders, bags and films."""
