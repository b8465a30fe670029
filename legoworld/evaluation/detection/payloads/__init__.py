"""What a detection is besides its category: a box or a mask, each as one value."""
