"""From profilometer scans to what rough-contact theories need: roughness, asperity radius and density."""
