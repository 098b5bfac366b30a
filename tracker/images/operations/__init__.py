"""Pure image operations: edges, chains, segments, chamfer images, background, principal axes."""
