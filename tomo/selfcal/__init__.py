"""What the images say of the cameras: shifts, poses, focal lengths, gains."""
