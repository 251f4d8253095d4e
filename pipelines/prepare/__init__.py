"""Before processing: look at files, draft a manifest."""
